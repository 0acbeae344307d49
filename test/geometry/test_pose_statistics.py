"""Means, deviations and distances of poses, with an axis of symmetry and without."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import pose_of, random_poses
from scipy.spatial.transform import Rotation
from scipy.special import softmax

from pmcl_ros.geometry.se3 import least_turn, retract
from pmcl_ros.geometry.symmetry import FREE_AXIS_VARIANCE, Symmetry
from pmcl_ros.pmcl.particles import perturb

AXES = [np.array(axis, float) / np.linalg.norm(axis)
        for axis in ([0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, -1], [1, 2, -0.5], [1e-7, 0, 1])]


def spun(poses, axis, angles):
    """Poses turned about the object's own axis."""
    result = poses.copy()
    turns = Rotation.from_rotvec(np.multiply.outer(angles, axis)).as_matrix()
    result[..., :3, :3] = poses[..., :3, :3] @ turns
    return result


def cloud(count=4000, sigma=(0.002, 0.001, 0.006), turn=(0.05, 0.02, 0.03), seed=0):
    pose = random_poses(1, seed)[0]
    poses = perturb(np.tile(pose, (count, 1, 1)), np.array(sigma), np.array(turn),
                    np.random.default_rng(seed))
    return pose, poses


@pytest.mark.parametrize('axis', AXES, ids=str)
@pytest.mark.parametrize('seed', range(5))
def test_canonical_turns_about_the_axis_alone(axis, seed):
    symmetry = Symmetry(axis)
    pose = random_poses(1, seed)[0]
    turned = symmetry.canonical_spin(pose)
    np.testing.assert_array_equal(turned[:3, 3], pose[:3, 3])
    np.testing.assert_allclose(turned[:3, :3] @ axis, pose[:3, :3] @ axis, atol=1e-7)
    np.testing.assert_allclose(turned[:3, :3] @ turned[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(turned[:3, :3]) > 0
    np.testing.assert_allclose(symmetry.canonical_spin(turned), turned, atol=1e-7)
    for angle in (0.3, 2.0, -3.0):
        again = symmetry.canonical_spin(spun(pose, axis, angle))
        np.testing.assert_allclose(again, turned, atol=1e-7)


def test_the_side_after_the_axis_faces_the_camera():
    for axis, side in (([0, 0, 1], [1, 0, 0]), ([1, 0, 0], [0, 1, 0]), ([0, 1, 0], [0, 0, 1])):
        for pose in random_poses(20, seed=1):
            turned = Symmetry(np.array(axis, float)).canonical_spin(pose)[:3, :3]
            to_camera = -pose[:3, 3]
            spindle = turned @ axis
            best = to_camera - spindle * (spindle @ to_camera)
            assert (turned @ side) @ best == pytest.approx(np.linalg.norm(best))


@pytest.mark.parametrize('axis', AXES[:5], ids=str)
@pytest.mark.parametrize('tilt', [0, 1e-9, np.pi])
def test_canonical_seen_along_the_axis(axis, tilt):
    symmetry = Symmetry(axis)
    position = np.array([0.1, -0.05, 0.5])
    ahead = least_turn(np.array(axis, float), position)
    pose = pose_of(Rotation.from_rotvec([tilt, 0, 0]) * ahead if tilt < 1 else
                   least_turn(np.array(axis, float), -position), position)
    turned = symmetry.canonical_spin(pose)
    assert np.isfinite(turned).all()
    np.testing.assert_allclose(turned[:3, :3] @ axis, pose[:3, :3] @ axis, atol=1e-7)
    np.testing.assert_allclose(symmetry.canonical_spin(spun(pose, axis, 1.0)), turned, atol=1e-6)


def test_canonical_without_symmetry_is_the_pose():
    pose = random_poses(1, 0)[0]
    assert Symmetry().canonical_spin(pose) is pose


@pytest.mark.parametrize('axis', AXES, ids=str)
def test_mean_and_covariance_under_symmetry_ignore_spins(axis):
    symmetry = Symmetry(axis)
    _, poses = cloud(300, seed=3)
    weights = softmax(np.random.default_rng(0).normal(size=300))
    expected = symmetry.mean_pose(poses, weights)
    angles = np.random.default_rng(1).uniform(-np.pi, np.pi, 300)
    turned = spun(poses, axis, angles)
    mean = symmetry.mean_pose(turned, weights)
    np.testing.assert_allclose(mean, expected, atol=1e-7)
    np.testing.assert_allclose(symmetry.covariance(turned, mean, weights),
                               symmetry.covariance(poses, expected, weights), atol=1e-6)
    np.testing.assert_allclose(mean[:3, 3], weights @ poses[:, :3, 3])
    direction = weights @ (poses[:, :3, :3] @ axis)
    np.testing.assert_allclose(mean[:3, :3] @ axis, direction / np.linalg.norm(direction),
                               atol=1e-7)


def test_mean_without_symmetry_is_near_the_middle_and_weighted():
    pose, poses = cloud()
    mean = Symmetry().mean_pose(poses)
    np.testing.assert_allclose(mean[:3, 3], pose[:3, 3], atol=3e-4)
    assert Symmetry().rotation_distance(mean[None], pose)[0] < 0.003
    one = np.where(np.arange(len(poses)) == 17, 1.0, 0.0)
    np.testing.assert_allclose(Symmetry().mean_pose(poses, one), poses[17], atol=1e-12)


def test_covariance_of_known_gaussians():
    sigma, turn = (0.002, 0.001, 0.006), (0.05, 0.02, 0.03)
    pose, poses = cloud(20_000, sigma, turn)
    expected = np.diag(np.square(sigma + turn))
    found = Symmetry().covariance(poses, pose)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.04)


@pytest.mark.parametrize('axis', AXES, ids=str)
def test_covariance_about_an_axis(axis):
    turn = 0.03
    pose, poses = cloud(20_000, turn=(turn,) * 3)
    found = Symmetry(axis).covariance(poses, pose)[3:, 3:]
    spindle = pose[:3, :3] @ axis
    expected = (FREE_AXIS_VARIANCE * np.outer(spindle, spindle)
                + turn ** 2 * (np.eye(3) - np.outer(spindle, spindle)))
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, 100_000)
    assert angles.var() == pytest.approx(FREE_AXIS_VARIANCE, rel=0.02)
    np.testing.assert_allclose(found, expected, atol=0.05 * turn ** 2)


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 12), st.integers(0, 2 ** 20), st.sampled_from([None, *AXES]),
       st.floats(0, 3))
def test_covariance_is_symmetric_and_positive_semi_definite(count, seed, axis, turn):
    symmetry = Symmetry(axis)
    rng = np.random.default_rng(seed)
    pose = random_poses(1, seed)[0]
    poses = perturb(np.tile(pose, (count, 1, 1)), 0.01, turn, rng)
    weights = softmax(rng.normal(size=count) * 5)
    found = symmetry.covariance(poses, symmetry.mean_pose(poses, weights), weights)
    assert found.shape == (6, 6)
    np.testing.assert_array_equal(found, found.T)
    assert np.linalg.eigvalsh(found).min() > -1e-12


def test_rotation_distance():
    pose = random_poses(1, 0)[0]
    about_z = spun(np.tile(pose, (3, 1, 1)), [0, 0, 1.0], np.array([0, 0.4, np.pi]))
    for axis, expected in ((None, [0, 0.4, np.pi]), (AXES[0], 0), (AXES[1], [0, 0.4, np.pi])):
        found = Symmetry(axis).rotation_distance(about_z, pose)
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_same_mode_needs_place_and_orientation():
    pose = random_poses(1, 0)[0]
    poses = np.tile(pose, (5, 1, 1))
    poses[1, 0, 3] += 0.009
    poses[2, 0, 3] += 0.011
    poses[3] = spun(pose, AXES[1], 0.19)
    poses[4] = spun(pose, AXES[1], 0.21)
    for axis, expected in ((None, [1, 1, 0, 1, 0]), (AXES[1], [1, 1, 0, 1, 1])):
        found = Symmetry(axis).same_mode(poses, pose, 0.01, 0.2)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize('axis', [None, AXES[0]], ids=['whole', 'symmetric'])
def test_levels_of_draws_from_the_covariance_are_uniform_and_heed_no_spin(axis):
    symmetry = Symmetry(axis)
    mean = random_poses(1, 3)[0]
    sigma = np.array([0.001, 0.002, 0.006, 0.02, 0.03, 0.01])
    basis = symmetry.tangent_basis(mean)
    spread = basis @ basis.T @ np.diag(sigma ** 2) @ basis @ basis.T
    rng = np.random.default_rng(0)
    draws = retract(mean, rng.multivariate_normal(np.zeros(6), spread, 1000, method='eigh'))
    np.testing.assert_allclose(symmetry.local(draws, mean) @ basis @ basis.T,
                               symmetry.local(draws, mean), atol=1e-9)
    if axis is not None:
        draws = spun(draws, axis, rng.uniform(0, 6, 1000))
        spread[3:, 3:] += FREE_AXIS_VARIANCE * np.outer(mean[:3, 2], mean[:3, 2])
    levels = np.sort([symmetry.credible_level(each, mean, spread) for each in draws])
    assert np.abs(levels - np.arange(1000) / 1000).max() < 0.06
    assert symmetry.credible_level(mean, mean, spread) == 0


@pytest.mark.parametrize('axis', [None, AXES[0]], ids=['whole', 'symmetric'])
def test_tangents_lead_back(axis):
    mean = random_poses(1, 1)[0]
    pose = retract(mean, np.array([[0.01, -0.02, 0.03, 0.1, -0.2, 0.15]]))
    back = retract(mean, Symmetry(axis).local(pose, mean))
    np.testing.assert_allclose(back[:, :3, 3], pose[:, :3, 3], atol=1e-12)
    assert Symmetry(axis).rotation_distance(back, pose[0])[0] < 1e-6
