"""The whole arrow, on edge volumes that show one object and nothing else."""

import gc
import logging
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pmcl_scenes import (
    COARSE,
    bracket,
    cup,
    depth_of,
    edges_seen,
    model_of,
    random_poses,
)
from waiting import eventually

from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume, edges_from_likelihood
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pipeline import make_localizer
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.modes import MODE_EXTENT
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.support import contour_support, share_in_view
from pmcl_ros.runtime.errors import LocalizationError, RenderError

DEPTHS = depth_labels(0.3, 0.7, 20)
CUP = model_of(cup(), [0, 0, 1])
BRACKET = model_of(bracket())
SETTINGS = PmclSettings(roi_center=(0, 0, 0.4), roi_size=(0.1, 0.1, 0.16))
REGION = Region(SETTINGS.roi_center, SETTINGS.roi_size)
# A search that is soon done, of a part of that region.
SMALL = SETTINGS.model_copy(update={'roi_center': (0, 0, 0.35), 'roi_size': (0.1, 0.1, 0.06),
                                    'proposals': 8, 'particles': 32, 'moves': 1})


def scene(context, model, seed):
    """A pose, and a volume in which the object is seen there."""
    truth = random_poses(1, seed, depth=(0.34, 0.42))[0]
    depth = depth_of(context, model, truth, COARSE, 4)
    edges = edges_seen(depth, COARSE, DEPTHS, 0.2 * model.radius, strength=2.0)
    # No picture is without any edges: faint ones, the same every way.
    tensor = edges.tensor + np.array([0.05, 0.05, 0], np.float32)
    return truth, replace(edges, tensor=tensor)


def localized(model, volume, seed=0, settings=SETTINGS, progress=None):
    with Localizer(model, settings) as localizer:
        return localizer.localize(volume, np.random.default_rng(seed), progress)


@pytest.fixture(scope='module')
def cup_scene(_session_context):
    _session_context.use()
    return scene(_session_context, CUP, 0)


@pytest.fixture
def cup_volume(context, cup_scene):
    return cup_scene[1]


def assert_valid(estimate, model):
    np.testing.assert_allclose(estimate.pose[:3, :3] @ estimate.pose[:3, :3].T, np.eye(3),
                               atol=1e-9)
    assert REGION.contains(estimate.pose[None, :3, 3]).all()
    np.testing.assert_allclose(estimate.pose, model.symmetry.canonical_spin(estimate.pose),
                               atol=1e-6)
    np.testing.assert_allclose(estimate.covariance, estimate.covariance.T)
    weights = [each.weight for each in estimate.modes]
    assert weights == sorted(weights, reverse=True)
    assert sum(weights) == pytest.approx(1)
    assert np.linalg.eigvalsh(estimate.covariance).min() > -1e-12
    assert len(estimate.particles) == len(estimate.log_weights)
    assert np.exp(estimate.log_weights).sum() == pytest.approx(1)
    assert estimate.mode == 'default'
    assert estimate.header.stamp_ns == 7


def test_a_vessel_is_localised_whatever_the_seed(context):
    errors, shares = [], []
    for seed in (0, 1, 2):
        truth, volume = scene(context, CUP, seed)
        estimate = localized(CUP, volume, seed)
        assert_valid(estimate, CUP)
        assert not estimate.lost
        spindle = estimate.pose[:3, 2]
        assert spindle @ estimate.covariance[3:, 3:] @ spindle == pytest.approx(
            np.pi ** 2 / 3, rel=0.01)
        error = pose_error(estimate.pose, truth, CUP.symmetry)
        errors.append((error.translation, error.rotation))
        ours = CUP.symmetry.same_mode(estimate.particles, estimate.pose, *MODE_EXTENT)
        off = estimate.particles[ours, :3, 3] - estimate.pose[:3, 3]
        shares.append(np.square(off).mean(axis=0) / np.diag(estimate.covariance)[:3])
    # Particles are spread as the covariance says, by the error of the model, too.
    assert np.mean(shares) == pytest.approx(1, rel=0.3)
    # The contour's pixels leave a millimetre or two along the line of sight.
    assert np.max(errors, axis=0)[0] < 0.005
    assert np.max(errors, axis=0)[1] < np.deg2rad(3)
    assert np.median(errors, axis=0)[0] < 0.002
    assert np.median(errors, axis=0)[1] < np.deg2rad(2)


def test_an_object_without_symmetry_is_localised(context):
    truth, volume = scene(context, BRACKET, 0)
    estimate = localized(BRACKET, volume)
    assert_valid(estimate, BRACKET)
    assert not estimate.lost
    error = pose_error(estimate.pose, truth, Symmetry())
    assert error.translation < 0.005
    assert error.rotation < np.deg2rad(10)


def test_the_same_seed_gives_the_identical_pose_in_any_localizer(cup_volume, context):
    with Localizer(CUP, SMALL) as localizer:
        other = localizer.localize(cup_volume, np.random.default_rng(6))
        again = localizer.localize(cup_volume, np.random.default_rng(5))
    fresh = localized(CUP, cup_volume, 5, SMALL)
    np.testing.assert_array_equal(again.pose, fresh.pose)
    np.testing.assert_array_equal(again.particles, fresh.particles)
    np.testing.assert_array_equal(again.log_weights, fresh.log_weights)
    np.testing.assert_array_equal(again.covariance, fresh.covariance)
    assert again.score == fresh.score
    assert (other.particles != fresh.particles).any()


def test_several_localizers_in_one_thread_do_not_meet(context, cup_volume):
    bracket_volume = scene(context, BRACKET, 1)[1]
    alone = [localized(CUP, cup_volume, 0, SMALL), localized(BRACKET, bracket_volume, 0, SMALL)]
    first, second = Localizer(CUP, SMALL), Localizer(BRACKET, SMALL)
    together = [first.localize(cup_volume, np.random.default_rng(0)),
                second.localize(bracket_volume, np.random.default_rng(0))]
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
    second.close()
    last = first.localize(cup_volume, np.random.default_rng(0))
    np.testing.assert_array_equal(last.pose, alone[0].pose)
    first.close()


def test_localizers_in_two_threads_at_once_do_not_meet(cup_volume):
    expected = localized(CUP, cup_volume, 3, SMALL)
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda _: localized(CUP, cup_volume, 3, SMALL), range(2)))
    for estimate in found:
        np.testing.assert_array_equal(estimate.pose, expected.pose)


@pytest.mark.parametrize('level', [0.0, 1.0])
def test_without_edges_the_object_is_lost(cup_volume, level):
    tensor = np.full_like(cup_volume.tensor, level) * np.array([1, 1, 0], np.float32)
    volume = EdgeVolume(cup_volume.header, tensor, DEPTHS, COARSE)
    estimate = localized(CUP, volume, 0, SMALL)
    assert estimate.lost
    assert_valid(estimate, CUP)


def test_a_region_that_is_hardly_in_view_is_told_once(cup_volume, caplog):
    left, _, depth = SMALL.roi_center
    aside = (left - (COARSE.cx + 5) * depth / COARSE.fx, 0.0, depth)  # its middle: 5 px beside
    with Localizer(CUP, SMALL.model_copy(update={'roi_center': aside})) as localizer:
        for _ in range(2):
            localizer.localize(cup_volume, np.random.default_rng(0), lambda _: False)
    told, = (each.message for each in caplog.records if 'outside of the image' in each.message)
    assert 'x right, y down, z forward' in told


def test_a_part_out_of_view_counts_as_no_evidence(context):
    """Else what little is in view would show the object."""
    truth = random_poses(1, 0, depth=(0.34, 0.42))[0]
    while share_in_view(CUP, truth, COARSE) > 0.75:
        truth[0, 3] -= 0.004
    edges = edges_seen(depth_of(context, CUP, truth, COARSE, 4), COARSE, DEPTHS,
                       0.2 * CUP.radius, strength=2.0)
    settings = SMALL.model_copy(update={'roi_center': tuple(truth[:3, 3])})
    with Localizer(CUP, settings) as localizer:
        estimate = localizer.localize(edges, np.random.default_rng(0))
        seen, = localizer.observe(edges, [estimate.pose])
    assert pose_error(estimate.pose, truth, CUP.symmetry).translation < 0.01
    assert estimate.in_view == seen.in_view < 0.9
    assert estimate.support == pytest.approx(contour_support(seen.points, seen.in_view))
    assert estimate.support < contour_support(seen.points, 1.0)


def test_texture_everywhere_is_no_object(cup_volume):
    """It supports each part of some outline a little, which least_support may let pass."""
    settings = SMALL.model_copy(update={'least_support': -5})
    for seed in range(2):
        picture = np.random.default_rng(seed).normal(size=(2, COARSE.height, COARSE.width))
        across, along = (cv2.GaussianBlur(each, (0, 0), 2.0) for each in picture)
        tensor = np.stack([across ** 2, along ** 2, across * along], axis=-1)[:, :, None]
        tensor = np.repeat(tensor / tensor.mean(), len(DEPTHS), axis=2).astype(np.float32)
        estimate = localized(CUP, replace(cup_volume, tensor=0.5 * tensor), seed, settings)
        assert estimate.lost
        assert -5 < estimate.support < estimate.evidence < ContourProfile.learned().least
    estimate = localized(CUP, cup_volume, 0, settings)
    assert not estimate.lost
    assert estimate.evidence > ContourProfile.learned().least


def test_an_object_that_is_not_there_is_lost(context):
    # Another object's contour, of another size: no pose of this one explains it.
    small = model_of(cup().apply_scale(0.4), [0, 0, 1])
    volume = scene(context, small, 0)[1]
    assert localized(CUP, volume).lost


def test_a_likelihood_alone_will_do(context, caplog):
    # What a message of the volume without its edges gives: high on contours at their depth.
    truth, volume = scene(context, CUP, 1)
    energy = volume.tensor[..., 0] + volume.tensor[..., 1]
    bare = DepthLikelihoodVolume(volume.header, np.sqrt(energy), DEPTHS, COARSE)
    with caplog.at_level(logging.INFO):
        estimate = localized(CUP, edges_from_likelihood(bare))
    assert 'no edge volume was given: contours are looked for in the likelihood' in caplog.text
    error = pose_error(estimate.pose, truth, CUP.symmetry)
    assert error.translation < 0.01
    assert error.rotation < np.deg2rad(5)


@pytest.mark.parametrize(('near', 'far'), [(0.1, 0.31), (0.49, 0.9)])
@pytest.mark.parametrize('mode', ['default', 'faithful'])
def test_a_volume_that_does_not_reach_the_region_is_refused(cup_volume, near, far, mode):
    depths = depth_labels(near, far, len(DEPTHS))
    edges = replace(cup_volume, depths=depths)
    likelihood = DepthLikelihoodVolume(edges.header, edges.tensor[..., 0].copy(), depths, COARSE)
    settings = SMALL.model_copy(update={'mode': mode})
    with make_localizer(CUP, settings) as localizer, pytest.raises(
            LocalizationError, match=r'the depth labels span .* set near and far'):
        localizer.localize(edges if mode == 'default' else likelihood, np.random.default_rng(0))


def test_a_region_outside_the_image_is_refused(cup_volume):
    settings = SMALL.model_copy(update={'roi_center': (2.0, 0.0, 0.4)})
    with pytest.raises(LocalizationError, match='outside the image'):
        localized(CUP, cup_volume, 0, settings)


@pytest.mark.parametrize('stop', range(0, 8, 2))
def test_progress_ends_the_search_early_with_what_was_found(cup_volume, stop):
    parts = []

    def progress(part):
        parts.append(part)
        return len(parts) <= stop

    estimate = localized(CUP, cup_volume, 0, SMALL, progress)
    assert len(parts) == stop + 1
    assert_valid(estimate, CUP)
    assert estimate.score > 0


def test_no_pose_comes_from_where_none_can_be(context, cup_scene):
    truth, volume = cup_scene
    with Localizer(CUP, SMALL) as localizer:
        found = localizer.localize(volume, np.random.default_rng(0))
        assert np.linalg.norm(found.pose[:3, 3] - truth[:3, 3]) < 0.005
        beside = localizer.localize(volume, np.random.default_rng(0), feasible=lambda poses: (
            np.linalg.norm(poses[:, :3, 3] - truth[:3, 3], axis=1) > 0.02))
        with pytest.raises(LocalizationError, match='no pose to start from'):
            localizer.localize(volume, np.random.default_rng(0), start=np.zeros((0, 4, 4)))
    for pose in (*(each.pose for each in beside.modes), *beside.particles):
        assert np.linalg.norm(pose[:3, 3] - truth[:3, 3]) > 0.018  # model errors move particles
    assert beside.score < found.score


def test_a_localizer_with_gl_belongs_to_its_thread_until_it_is_closed(cup_volume):
    localizer = Localizer(CUP, SMALL.model_copy(update={'renderer': 'gl'}))
    with ThreadPoolExecutor(1) as pool:
        for work in (lambda: localizer.localize(cup_volume, np.random.default_rng(0)),
                     localizer.close):
            with pytest.raises(RenderError, match='belongs to another thread'):
                pool.submit(work).result()
    localizer.localize(cup_volume, np.random.default_rng(0), lambda _: False)
    localizer.close()
    localizer.close()
    with pytest.raises(RenderError, match='has been closed'):
        localizer.localize(cup_volume, np.random.default_rng(0))


def test_what_a_search_holds_is_given_back(cup_volume):
    def memory():
        gc.collect()
        pages = int(Path('/proc/self/statm').read_text().split()[1])
        return pages * os.sysconf('SC_PAGE_SIZE') / 2 ** 20

    def search(localizer):
        localizer.localize(cup_volume, np.random.default_rng(0), lambda _: False)

    textures = cup_volume.tensor.nbytes / 2 ** 20  # one of two that a search holds
    with Localizer(CUP, SMALL) as localizer:
        for _ in range(4):
            search(localizer)
        before = memory()
        for _ in range(10):
            search(localizer)
        assert memory() - before < 6 * textures
    threads = set(threading.enumerate())
    for _ in range(3):
        with Localizer(CUP, SMALL) as localizer:
            search(localizer)
    eventually(lambda: set(threading.enumerate()) <= threads)
    assert memory() - before < 6 * textures
