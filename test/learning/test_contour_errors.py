"""How far contours lie off, from poses whose errors were drawn."""

import numpy as np
import pytest
from scipy.stats import chi2

from pmcl_ros.learning.contour_errors import LEVEL, Deviation, fitted_error, fitted_offset
from pmcl_ros.runtime.errors import LocalizationError

COUNT = 400


def drawn(common, local, seed=0, tails=np.inf, offset=0.0):
    """Deviations by noise and model errors of these sizes; tails: freedoms of Student's t.

    offset: of all contours [px].
    """
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(COUNT):
        roots = rng.normal(size=(3, 5, 5)) * np.array([0.001, 0.004, 0.003])[:, None, None]
        noise, of_common, of_local = (root @ root.T for root in roots)
        spread = noise + common ** 2 * of_common + local ** 2 * of_local
        size = 1.0 if np.isinf(tails) else np.sqrt(tails / rng.chisquare(tails))
        moved = roots[1].sum(axis=1)
        deviation = size * rng.multivariate_normal(np.zeros(5), spread) - offset * moved
        found.append(Deviation(deviation, noise, of_common, of_local, moved))
    return found


@pytest.mark.parametrize(('common', 'local'), [(0.2, 0.4), (0.5, 0.15)])
def test_the_sizes_of_errors_are_recovered(common, local):
    error = fitted_error(drawn(common, local))
    assert error.common == pytest.approx(common, rel=0.15)
    assert error.local == pytest.approx(local, rel=0.15)


@pytest.mark.parametrize('offset', [0.0, -0.3])
def test_where_contours_are_found_is_recovered(offset):
    assert fitted_offset(drawn(0.2, 0.4, offset=offset)) == pytest.approx(offset, abs=0.03)


def test_with_long_tails_the_regions_hold_as_many_as_they_say():
    found = drawn(0.2, 0.4, tails=4)
    error = fitted_error(found)
    levels = np.array([each.level(error.common, error.local) for each in found])
    assert (levels <= LEVEL).mean() == pytest.approx(LEVEL, abs=0.01)
    assert error.common > 0.2
    fresh = drawn(0.2, 0.4, seed=1, tails=4)
    levels = np.array([each.level(error.common, error.local) for each in fresh])
    assert (levels <= LEVEL).mean() == pytest.approx(LEVEL, abs=0.05)


def test_a_level_is_that_of_the_ellipsoid():
    noise = np.diag([1.0, 4, 9, 16, 25])
    off = Deviation(np.sqrt(np.diag(noise)), noise, np.eye(5), np.eye(5), np.zeros(5))
    assert off.level(0, 0) == pytest.approx(chi2.cdf(5, 5))
    assert off.level(1, 0) == pytest.approx(off.level(0, 1))
    assert off.level(1, 0) < off.level(0, 0)


def test_nothing_is_learned_from_nothing():
    with pytest.raises(LocalizationError, match='0 poses'):
        fitted_error([])
    with pytest.raises(LocalizationError, match='0 poses'):
        fitted_offset([])
