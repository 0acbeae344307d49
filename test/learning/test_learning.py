import subprocess
import sys
from functools import cache

import cv2
import numpy as np
import pytest
import trimesh
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.learned import NO_SLOPES, SupportSlopes
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.learning.contour_errors import Deviation
from pmcl_ros.learning.contour_tables import (
    KNOTS,
    OFFSETS,
    SHIFTS,
    Example,
    Samples,
    crease_profile,
    fitted,
    profiles,
)
from pmcl_ros.learning.searches import Search, Supports, searches, slopes_of
from pmcl_ros.pmcl.estimator import Thresholds
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.creases import Creases
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.runtime.errors import LocalizationError
from pmcl_ros.simulation.edge_scenes import random_edge_scene

NO_DEVIATION = Deviation(np.zeros(1), np.eye(1), np.eye(1), np.eye(1), np.zeros(1))


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


@cache
def example(seed):
    scene = random_edge_scene(np.random.default_rng(seed), ModelError(0.1, 0.1, 40))
    return Example(scene.edges, scene.model, scene.pose,
                   Region(scene.roi_center, scene.roi_size))


def test_what_is_learned_prefers_true_poses():
    rng = np.random.default_rng(0)
    given = [profiles(example(k), NumbaRenderer(), rng)[0] for k in range(3)]
    profile = fitted(Samples.joined(given))
    unseen = profiles(example(9), NumbaRenderer(), rng)[0]
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
    one, two = example(0), example(1)
    found = Supports.from_searches([
        *searches(one, [], ContourProfile.learned(), 0),
        *searches(two, [one.model], ContourProfile.learned(), 0)])
    assert (len(found.there), len(found.elsewhere)) == (2, 1)
    assert np.median(found.there) > np.median(found.elsewhere)
    assert len(found.evidence) == 2
    assert (found.evidence > ContourProfile.learned().least).all()
    with pytest.raises(LocalizationError):
        Supports.from_searches([])


def test_a_broken_file_can_be_learned_again(package_tree):
    learned = package_tree / 'config' / 'learned' / 'contour.yaml'
    learned.rename(package_tree / 'old.yaml')
    learned.write_text('broken')
    done = subprocess.run([sys.executable, '-c', """
import numpy as np

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.learned import LearnedContour
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.learning.contour_tables import Example
from pmcl_ros.learning.searches import searches
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.simulation.edge_scenes import random_edge_scene

scene = random_edge_scene(np.random.default_rng(0), ModelError(0.1, 0.1, 40))
example = Example(scene.edges, scene.model, scene.pose, Region(scene.roi_center, scene.roi_size))
profile = ContourProfile.from_numbers(LearnedContour.load('old.yaml'))
found, = searches(example, [], profile, 0)
print(found.there, found.deviation.noise.shape)
"""], cwd=package_tree, capture_output=True, text=True, check=False)
    assert done.stdout == 'True (5, 5)\n', done.stderr


def test_the_slopes_are_those_of_the_odds():
    """Of two Gaussians with one covariance, the odds are linear."""
    rng = np.random.default_rng(0)
    root = np.array([[0.5, 0, 0, 0], [0.1, 0.3, 0, 0], [0.3, 0.2, 1.0, 0], [0.2, 0.1, 0.1, 0.4]])
    odds = np.array([3.0, 2.0, 0.8, -1.5])  # for a unit of support, evidence, log odds, inside
    apart = root @ root.T @ odds
    found = []
    for there in (True, False):
        for support, evidence, of_weight, inside in (
                rng.normal(size=(40000, 4)) @ root.T + there * apart):
            weight = 0.5 + 0.5 * np.tanh(of_weight / 2)
            found.append(Search(there, support, evidence, weight, inside,
                                NO_DEVIATION if there else None))
    slopes = slopes_of(found, 0.0)
    np.testing.assert_allclose(slopes, np.array([2.0, 0.8, 1.5]) / 3.0, rtol=0.1)
    # At as many false alarms, the best rule claims what the distance of the Gaussians lets it.
    for used, distance in ((slopes, np.sqrt(odds @ apart)), (NO_SLOPES, apart[0] / root[0, 0])):
        supports = Supports.from_searches(found, slopes=used)
        least = Thresholds(supports.threshold(0.05), -np.inf, slopes=used)
        share = [np.mean([each.is_claimed(least) for each in found if each.there is there])
                 for there in (True, False)]
        assert share[1] == pytest.approx(0.05, abs=0.002)
        assert share[0] == pytest.approx(1 - supports.missed(least.support), abs=0.002)
        assert share[0] == pytest.approx(norm.cdf(distance - norm.ppf(0.95)), abs=0.01)


def test_a_search_that_found_no_contour_has_no_support():
    nothing = Search(False, -np.inf, -np.inf, 1.0, 0.0)
    for slopes in (NO_SLOPES, SupportSlopes(0.5, 0.3, 0.2)):
        assert nothing.margin(slopes) == -np.inf
        assert not nothing.is_claimed(Thresholds(-9.0, -9.0, slopes=slopes))
    found = [Search(True, 1.0, 1.0, 1.0, 0.0, NO_DEVIATION),
             *[Search(False, 0.0, 1.0, 1.0, 0.0)] * 99]
    assert Supports.from_searches([*found, nothing]).threshold(0.05) == 0.0


@pytest.mark.parametrize('kept', [{True}, {False}, set()])
def test_slopes_need_right_poses_and_others(kept):
    found = [Search(there, support, 1.0, 1.0, 0.0, NO_DEVIATION if there else None)
             for there in kept for support in np.linspace(0, 1, 20) + there]
    told = f'{20 * (True in kept)} right poses and {20 * (False in kept)} poses'
    with pytest.raises(LocalizationError, match=told):
        slopes_of(found, 0.0)


def test_the_threshold_is_exceeded_as_often_as_asked():
    found = Supports(np.linspace(0, 1, 11), np.linspace(-1, 0, 1001), np.linspace(0, 1, 1001))
    least = found.threshold(0.05)
    assert (found.elsewhere > least).mean() == pytest.approx(0.05, abs=2e-3)
    assert (found.evidence < found.least_evidence(0.05)).mean() == pytest.approx(0.05, abs=2e-3)
    assert found.missed(least) == 0
    assert found.missed(0.35) == pytest.approx(4 / 11)


def block_example(seed):
    """Edges of a box: its outline and the creases inside it, as sharp at every depth."""
    rng = np.random.default_rng(seed)
    mesh = trimesh.creation.box((0.06, 0.045, 0.03))
    model = ObjectModel('box', np.array(mesh.vertices), np.array(mesh.faces, np.int64), None, True)
    camera = Pinhole(140, 140, 700.0, 700.0, 69.5, 69.5)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler('xyz', rng.uniform(0.4, 0.7, 3)).as_matrix()
    pose[:3, 3] = 0, 0, 0.5
    lines = np.zeros((140, 140), np.uint8)
    creases = Creases.from_model(model)
    for ends, normals in zip(creases.ends, creases.normals, strict=True):
        there = ends @ pose[:3, :3].T + pose[:3, 3]
        if (normals @ pose[:3, :3].T @ there[0] < 0).any():
            first, last = np.rint(8 * camera.project(there)).astype(int).tolist()
            cv2.line(lines, first, last, 255, 1, cv2.LINE_AA, 3)
    smooth = gaussian_filter(lines / 255.0 + 0.02 * rng.random((140, 140)), 1)
    gy, gx = np.gradient(gaussian_filter(smooth, 1))
    tensor = np.stack([gx * gx, gy * gy, gx * gy], axis=-1)
    tensor = np.stack([gaussian_filter(each, 1) for each in np.moveaxis(tensor, -1, 0)], axis=-1)
    tensor *= 4 / tensor[..., :2].sum(axis=-1).max()
    edges = EdgeVolume(Header(), np.repeat(tensor[:, :, None], 2, axis=2).astype(np.float32),
                       depth_labels(0.4, 0.6, 2), camera)
    return Example(edges, model, pose, Region((0, 0, 0.5), (0.06, 0.06, 0.06)))


def test_what_creases_say_has_no_side():
    rng = np.random.default_rng(0)
    renderer = NumbaRenderer()
    given = [each for seed in range(3)
             for each in profiles(block_example(seed), renderer, rng, of_creases=True)]
    assert len(given) == 3
    profile = crease_profile(given)
    np.testing.assert_allclose(profile.tables, profile.tables[::-1], atol=1e-3)
    unseen = profiles(block_example(7), renderer, rng, of_creases=True)[0]
    assert unseen.weights.sum() == pytest.approx(1)
    said = profile.evidence(unseen.energies)
    assert said[unseen.there].mean() > 0 > said[~unseen.there].mean()
    assert profiles(example(0), renderer, rng, of_creases=True) == []  # a surface of revolution


def test_nothing_is_learned_from_no_scene():
    with pytest.raises(LocalizationError, match='0 of the scenes show'):
        Samples.joined([])
