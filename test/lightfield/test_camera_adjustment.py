"""Camera poses by what the pictures show of the surroundings: against the true ones."""

from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from textured_planes import MIDDLE, around, views_of_planes

from pmcl_ros.geometry.se3 import local, retract
from pmcl_ros.lightfield.camera_adjustment import adjust_cameras, pair_fits
from pmcl_ros.lightfield.features import MATCHED, Features, features_of


def deviations(cameras, true):
    """(n, 6) by which cameras are off, in their own frames."""
    return local(np.linalg.inv(true) @ cameras, np.eye(4))


CAMERAS = around([-24, -12, 0, 12])


def adjusted_by(views):
    return adjust_cameras(views, [features_of(each) for each in views])


def fits_of(views, cameras):
    return pair_fits(views, [features_of(each) for each in views], cameras)


def test_exact_poses_are_not_off():
    adjusted = adjusted_by(views_of_planes(CAMERAS))
    assert not adjusted.is_needed
    assert adjusted.before < 0.2


def test_what_a_mask_leaves_out_is_no_surroundings():
    """A gripper is at one place in all pictures, as if the cameras were at rest."""
    gripper, seen = np.random.default_rng(0).random((100, 320, 3), np.float32), []
    for each in views_of_planes(CAMERAS):
        picture, mask = each.picture.copy(), np.ones(each.picture.shape[:2], bool)
        picture[-100:], mask[-100:] = gripper, False
        seen.append(replace(each, picture=picture, mask=mask))

    def lowest(view):
        return (view.pinhole.fy * features_of(view).rays[:, 1] + view.pinhole.cy).max()

    for each in seen:
        assert lowest(each) < each.pinhole.height - 100 < lowest(replace(each, mask=None)) - 50
    assert not adjusted_by(seen).is_needed
    assert max(pair.excess for pair in fits_of(seen, [CAMERAS])) < 1


@pytest.mark.parametrize('seed', range(2))
def test_poses_that_are_off_are_brought_back_as_far_as_they_say(seed):
    rng = np.random.default_rng(seed)
    errors = rng.normal(size=(4, 6)) * np.repeat([0.0015, 0.005], 3)
    told = CAMERAS @ retract(np.tile(np.eye(4), (4, 1, 1)), errors)
    adjusted = adjusted_by(views_of_planes(CAMERAS, told, seed))
    assert adjusted.is_needed
    assert adjusted.before > 1
    assert adjusted.after < 0.3
    left = deviations(adjusted.cameras, CAMERAS).ravel()
    covariance = np.einsum('aik,bjk->aibj', adjusted.root, adjusted.root).reshape(24, 24)
    assert left @ np.linalg.solve(covariance, left) < chi2.isf(1e-3, 24)
    # How the cameras are turned to each other is what the pictures tell best.
    turns = {name: Rotation.from_matrix(np.linalg.inv(each[:-1, :3, :3]) @ each[1:, :3, :3])
             for name, each in (('true', CAMERAS), ('told', told), ('found', adjusted.cameras))}
    off = {name: (turns[name] * turns['true'].inv()).magnitude().mean()
           for name in ('told', 'found')}
    assert off['found'] < 0.4 * off['told']


@pytest.mark.parametrize('count', [2, 4])
def test_motions_that_are_unlikely_of_reported_poses_are_not_made(count):
    """Not even where some of the pairs, without the others, tell of likely ones."""
    turns = 0.017 * np.array([[1, 1, 1], [-1, -1, -1]] * (count // 2))  # 2.4 sigma each
    told = CAMERAS[:count] @ retract(np.tile(np.eye(4), (count, 1, 1)),
                                     np.concatenate([np.zeros((count, 3)), turns], axis=1))
    assert adjusted_by(views_of_planes(CAMERAS[:count], told)) is None


def matching_features(cameras, repeated):
    """Of views; each pair of them shows 40 points of its own.

    repeated: periods (3,) by which pairs take each point for one that is aside [m].
    """
    rng = np.random.default_rng(0)
    rays, descriptors = ([[] for _ in cameras] for _ in range(2))
    for pair in combinations(range(len(cameras)), 2):
        points = MIDDLE + rng.uniform(-0.15, 0.15, (40, 3))
        words = rng.uniform(0, 255, (40, 128))
        for number, view in enumerate(pair):
            seen = points + (repeated.get(pair, 0) if number else 0) - cameras[view][:3, 3]
            seen = seen @ cameras[view][:3, :3]
            rays[view].append(seen / seen[:, 2:] + rng.normal(0, 0.0003, (40, 3)) * [1, 1, 0])
            descriptors[view].append(words)
    return [Features(np.concatenate(one), np.concatenate(other).astype(np.float32), 600.0)
            for one, other in zip(rays, descriptors, strict=True)]


@pytest.mark.parametrize('off', [0.0, 0.004])
def test_pairs_that_match_a_pattern_a_period_off_are_left_out(off):
    """Their motions are unlikely, whether the reported poses are exact or off by `off` [rad]."""
    period = np.array([0.0, 0.022, 0.0])
    repeated = {(0, 2): period, (1, 3): period, (0, 3): -period}
    turns = off * np.random.default_rng(1).normal(size=(4, 6)) * np.repeat([0.0, 1.0], 3)
    views = views_of_planes(CAMERAS, CAMERAS @ retract(np.tile(np.eye(4), (4, 1, 1)), turns))
    adjusted = adjust_cameras(views, matching_features(CAMERAS, repeated))
    assert adjusted.is_needed == bool(off)
    assert adjusted.after < 0.3
    left = deviations(adjusted.cameras, CAMERAS).ravel()
    covariance = np.einsum('aik,bjk->aibj', adjusted.root, adjusted.root).reshape(24, 24)
    assert left @ np.linalg.solve(covariance, left) < chi2.isf(1e-3, 24)


def test_a_view_without_matches_stays_as_reported_and_as_uncertain():
    turns = 0.004 * np.random.default_rng(1).normal(size=(4, 6)) * np.repeat([0.0, 1.0], 3)
    told = CAMERAS @ retract(np.tile(np.eye(4), (4, 1, 1)), turns)
    features = matching_features(CAMERAS, {})
    none = Features(np.zeros((0, 3)), np.zeros((0, 128), np.float32), 600.0)
    adjusted = adjust_cameras(views_of_planes(CAMERAS, told), [*features[:3], none])
    assert adjusted.is_needed
    np.testing.assert_allclose(adjusted.cameras[3], told[3], atol=1e-12)
    sigmas = np.sqrt(np.square(adjusted.root).sum(axis=2))
    np.testing.assert_allclose(sigmas[3], np.repeat([0.002, 0.007], 3), rtol=0.01)
    assert (sigmas[:3, 3:] < 0.8 * 0.007).any(axis=1).all()


def test_any_poses_are_judged_by_pairs_of_neighbours():
    told = CAMERAS.copy()
    told[1, :3, :3] = told[1, :3, :3] @ Rotation.from_euler('z', 90, degrees=True).as_matrix()
    fits = fits_of(views_of_planes(CAMERAS, told), [told, CAMERAS])
    assert [each.views for each in fits] == [(0, 1), (1, 2), (2, 3)]
    assert [each.excess > 1 for each in fits] == [True, True, False]
    assert max(each.distances[1] for each in fits) < MATCHED


@pytest.mark.parametrize('order', [[4, 1, 2, 3, 0], [4, 0, 1, 2, 3]],
                         ids=['first and last exchanged', 'one late'])
def test_pictures_with_the_poses_of_others_are_told_by_those_that_show_most_of_the_same(order):
    """Over 35 degrees two pictures show little of the same, next to each other in the list."""
    cameras = around([-70, -35, 0, 35, 70])
    right = fits_of(views_of_planes(cameras), [cameras])
    assert right
    assert max(each.excess for each in right) < 0.1
    assert max(each.excess for each in fits_of(views_of_planes(cameras[order], cameras),
                                               [cameras])) > 2


def test_stated_errors_allow_more():
    views = views_of_planes(CAMERAS[:2])
    stated = [replace(each, sigma=(0.02, 0.07)) for each in views]  # ten times those taken
    (fit,), (loose,) = (fits_of(each, [CAMERAS[:2]]) for each in (views, stated))
    assert loose.allowed == pytest.approx(10 * fit.allowed)


def test_a_large_picture_is_reduced_with_its_camera():
    views = []
    for view in views_of_planes(CAMERAS):
        picture = cv2.resize(view.picture, (1920, 1440), interpolation=cv2.INTER_CUBIC).clip(0, 1)
        views.append(replace(view, picture=picture, pinhole=view.pinhole.resized(1920, 1440)))
    adjusted = adjusted_by(views)
    assert not adjusted.is_needed
    assert deviations(adjusted.cameras, CAMERAS)[:, 3:].std() < 0.002


def test_without_texture_nothing_is_told():
    assert adjusted_by(views_of_planes(CAMERAS, contrast=0.0)) is None
    assert fits_of(views_of_planes(CAMERAS, contrast=0.0), [CAMERAS]) == []
    assert adjusted_by(views_of_planes(CAMERAS[:1])) is None
