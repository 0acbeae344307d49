import numpy as np
import pytest

from pmcl_ros.errors import LocalizationError
from pmcl_ros.evaluation.coverage import _drawn
from pmcl_ros.evaluation.edge_scenes import random_edge_scene
from pmcl_ros.evaluation.learning import (
    KNOTS,
    OFFSETS,
    Example,
    Samples,
    Supports,
    fitted,
    samples,
    supports,
)
from pmcl_ros.pmcl.contour_profile import ContourProfile
from pmcl_ros.pmcl.model_error import ModelError
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer


def test_log_odds_of_independent_energies_are_recovered():
    # Exponential energies, twice as large on a contour at one offset: log odds e / 2 - log 2.
    rng = np.random.default_rng(0)
    there = rng.random(40000) < 0.5
    energies = rng.exponential(1.0, (len(there), len(OFFSETS)))
    energies[there, 3] *= 2
    profile = fitted(Samples(energies, there, np.ones(len(there))), ridge=1e-5)
    assert np.ptp(profile.tables[[0, 1, 2, 4, 5, 6]], axis=1).max() < 0.4
    steps = profile.tables[3] - profile.tables[3, 0]
    np.testing.assert_allclose(steps[1:7], KNOTS[1:7] / 2, atol=0.15)


def example(seed):
    scene = random_edge_scene(np.random.default_rng(seed), _drawn, ModelError(0.1, 0.1, 40))
    return Example(scene.volume.edges, scene.model, scene.pose,
                   Region(scene.roi_center, scene.roi_size))


def test_what_is_learned_prefers_true_poses():
    rng = np.random.default_rng(0)
    profile = fitted(samples([example(k) for k in range(3)], NumbaRenderer(), rng))
    unseen = samples([example(9)], NumbaRenderer(), rng)
    said = profile.evidence(unseen.energies)
    assert said[unseen.there].mean() > 0 > said[~unseen.there].mean()
    assert unseen.weights.sum() == pytest.approx(1)


def test_objects_that_are_elsewhere_have_less_support():
    found = supports([example(k) for k in range(2)], ContourProfile.learned(), 0)
    assert (len(found.there), len(found.elsewhere)) == (2, 1)  # the first has none before it
    assert np.median(found.there) > np.median(found.elsewhere)
    with pytest.raises(LocalizationError):
        supports([], ContourProfile.learned(), 0)


def test_the_threshold_is_exceeded_as_often_as_asked():
    found = Supports(np.linspace(0, 1, 11), np.linspace(-1, 0, 1001))
    least = found.threshold(0.05)
    assert (found.elsewhere > least).mean() == pytest.approx(0.05, abs=2e-3)
    assert found.missed(least) == 0
    assert found.missed(0.35) == pytest.approx(4 / 11)
