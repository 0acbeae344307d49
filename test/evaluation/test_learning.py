import numpy as np
import pytest

from pmcl_ros.errors import LocalizationError
from pmcl_ros.evaluation.coverage import _drawn
from pmcl_ros.evaluation.edge_scenes import random_edge_scene
from pmcl_ros.evaluation.learning import (
    KNOTS,
    OFFSETS,
    SHIFTS,
    Example,
    Samples,
    fitted,
    samples,
)
from pmcl_ros.evaluation.searches import Supports, searches
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


def test_what_is_learned_is_largest_where_the_contour_is():
    # Edges everywhere along the contour, so that alone where they lie tells anything: energies of
    # an edge 1.2 px wide, of any strength.
    rng = np.random.default_rng(0)
    strength = rng.uniform(0.5, 3, 3000)
    away = np.add.outer(SHIFTS, OFFSETS)
    shifted = strength[:, None, None] * np.exp(-0.5 * (away / 1.2) ** 2)
    here = shifted[:, len(SHIFTS) // 2]
    noise = rng.exponential(0.3, here.shape)
    there = np.arange(2 * len(here)) < len(here)
    weights = np.full(len(there), 0.5 / len(here))
    given = Samples(np.concatenate([here, noise]), there, weights, shifted,
                    np.full(len(here), 1 / len(here)))
    profile = fitted(given)
    said = profile.evidence(shifted.reshape(-1, len(OFFSETS))).reshape(len(here), -1).mean(axis=0)
    assert SHIFTS[said.argmax()] == 0
    alone = fitted(Samples(given.energies, there, weights))
    loose = alone.evidence(shifted.reshape(-1, len(OFFSETS))).reshape(len(here), -1).mean(axis=0)
    assert np.ptp(said[4:9]) > np.ptp(loose[4:9])


def test_objects_that_are_elsewhere_have_less_support():
    found = Supports.of(list(searches([example(k) for k in range(2)],
                                      ContourProfile.learned(), 0)))
    assert (len(found.there), len(found.elsewhere)) == (2, 1)  # the first has none before it
    assert np.median(found.there) > np.median(found.elsewhere)
    with pytest.raises(LocalizationError):
        Supports.of([])


def test_the_threshold_is_exceeded_as_often_as_asked():
    found = Supports(np.linspace(0, 1, 11), np.linspace(-1, 0, 1001))
    least = found.threshold(0.05)
    assert (found.elsewhere > least).mean() == pytest.approx(0.05, abs=2e-3)
    assert found.missed(least) == 0
    assert found.missed(0.35) == pytest.approx(4 / 11)
