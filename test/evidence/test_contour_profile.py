import numpy as np
import pytest

from pmcl_ros.evidence.contour_profile import ContourProfile


@pytest.mark.parametrize('profile', [ContourProfile.contrast(), ContourProfile.learned()])
def test_evidence_is_read_between_knots_and_constant_beyond(profile):
    rng = np.random.default_rng(0)
    assert profile.tables.shape == (len(profile.offsets), len(profile.knots))
    assert (np.diff(profile.offsets) > 0).all()
    energies = rng.uniform(0, 3, (50, len(profile.offsets)))
    at = np.minimum(energies, profile.knots[-1])
    expected = profile.bias + sum(
        np.interp(at[:, j], profile.knots, profile.tables[j]) for j in range(at.shape[1]))
    np.testing.assert_allclose(profile.evidence(energies), expected, rtol=1e-6)


def test_an_edge_speaks_for_a_contour_and_its_absence_or_one_outside_against():
    profile = ContourProfile.learned()
    here = np.exp(-0.5 * (profile.offsets / 0.9) ** 2) * 1.6 + 0.25
    outside = np.exp(-0.5 * ((profile.offsets - 4) / 0.9) ** 2) * 1.6 + 0.25
    nothing = np.full(len(profile.offsets), 0.25)
    good, bad, none = profile.evidence(np.stack([here, outside, nothing]))
    assert good > 0 > none
    assert bad < 0
