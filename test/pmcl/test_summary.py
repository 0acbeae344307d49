import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import pose_of, random_poses
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.motion import perturb
from pmcl_ros.pmcl.summary import (
    FREE_AXIS_VARIANCE,
    canonical,
    covariance,
    credible_level,
    mean_pose,
    rotation_distance,
    same_mode,
    tangent,
    tangent_basis,
)
from pmcl_ros.pmcl.weights import Weights

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
    return pose, poses, Weights(np.zeros(count))


@pytest.mark.parametrize('axis', AXES, ids=str)
@pytest.mark.parametrize('seed', range(5))
def test_canonical_turns_about_the_axis_alone(axis, seed):
    pose = random_poses(1, seed)[0]
    turned = canonical(pose, axis)
    np.testing.assert_array_equal(turned[:3, 3], pose[:3, 3])
    np.testing.assert_allclose(turned[:3, :3] @ axis, pose[:3, :3] @ axis, atol=1e-7)
    np.testing.assert_allclose(turned[:3, :3] @ turned[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(turned[:3, :3]) > 0
    np.testing.assert_allclose(canonical(turned, axis), turned, atol=1e-7)
    for angle in (0.3, 2.0, -3.0):
        np.testing.assert_allclose(canonical(spun(pose, axis, angle), axis), turned, atol=1e-7)


def test_the_side_after_the_axis_faces_the_camera():
    for axis, side in (([0, 0, 1], [1, 0, 0]), ([1, 0, 0], [0, 1, 0]), ([0, 1, 0], [0, 0, 1])):
        for pose in random_poses(20, seed=1):
            turned = canonical(pose, np.array(axis, float))[:3, :3]
            to_camera = -pose[:3, 3]
            spindle = turned @ axis
            best = to_camera - spindle * (spindle @ to_camera)
            assert (turned @ side) @ best == pytest.approx(np.linalg.norm(best))


@pytest.mark.parametrize('axis', AXES[:5], ids=str)
@pytest.mark.parametrize('tilt', [0, 1e-9, np.pi])
def test_canonical_seen_along_the_axis(axis, tilt):
    position = np.array([0.1, -0.05, 0.5])
    ahead = Rotation.align_vectors(position[None] / np.linalg.norm(position), axis[None])[0]
    pose = pose_of(Rotation.from_rotvec([tilt, 0, 0]) * ahead if tilt < 1 else
                   Rotation.align_vectors(-position[None], axis[None])[0], position)
    turned = canonical(pose, axis)
    assert np.isfinite(turned).all()
    np.testing.assert_allclose(turned[:3, :3] @ axis, pose[:3, :3] @ axis, atol=1e-7)
    np.testing.assert_allclose(canonical(spun(pose, axis, 1.0), axis), turned, atol=1e-6)


def test_canonical_without_symmetry_is_the_pose():
    pose = random_poses(1, 0)[0]
    assert canonical(pose, None) is pose


@pytest.mark.parametrize('axis', AXES, ids=str)
def test_mean_and_covariance_under_symmetry_ignore_spins(axis):
    _, poses, _ = cloud(300, seed=3)
    weights = Weights(np.random.default_rng(0).normal(size=300))
    expected = mean_pose(poses, weights, axis)
    angles = np.random.default_rng(1).uniform(-np.pi, np.pi, 300)
    turned = spun(poses, axis, angles)
    mean = mean_pose(turned, weights, axis)
    np.testing.assert_allclose(mean, expected, atol=1e-7)
    np.testing.assert_allclose(covariance(turned, weights, mean, axis),
                               covariance(poses, weights, expected, axis), atol=1e-6)
    np.testing.assert_allclose(mean[:3, 3], weights.normalised @ poses[:, :3, 3])
    direction = weights.normalised @ (poses[:, :3, :3] @ axis)
    np.testing.assert_allclose(mean[:3, :3] @ axis, direction / np.linalg.norm(direction),
                               atol=1e-7)


def test_mean_without_symmetry_is_near_the_middle_and_weighted():
    pose, poses, weights = cloud()
    mean = mean_pose(poses, weights, None)
    np.testing.assert_allclose(mean[:3, 3], pose[:3, 3], atol=3e-4)
    assert rotation_distance(mean[None], pose, None)[0] < 0.003
    one = Weights(np.where(np.arange(len(poses)) == 17, 0, -np.inf))
    np.testing.assert_allclose(mean_pose(poses, one, None), poses[17], atol=1e-12)


def test_covariance_of_known_gaussians():
    sigma, turn = (0.002, 0.001, 0.006), (0.05, 0.02, 0.03)
    pose, poses, weights = cloud(20_000, sigma, turn)
    expected = np.diag(np.square(sigma + turn))
    found = covariance(poses, weights, pose, None)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.04)


@pytest.mark.parametrize('axis', AXES, ids=str)
def test_covariance_about_an_axis(axis):
    turn = 0.03
    pose, poses, weights = cloud(20_000, turn=(turn,) * 3)
    found = covariance(poses, weights, pose, axis)[3:, 3:]
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
    rng = np.random.default_rng(seed)
    pose = random_poses(1, seed)[0]
    poses = perturb(np.tile(pose, (count, 1, 1)), 0.01, turn, rng)
    weights = Weights(rng.normal(size=count) * 5)
    found = covariance(poses, weights, mean_pose(poses, weights, axis), axis)
    assert found.shape == (6, 6)
    np.testing.assert_array_equal(found, found.T)
    assert np.linalg.eigvalsh(found).min() > -1e-12


def test_rotation_distance():
    pose = random_poses(1, 0)[0]
    about_z = spun(np.tile(pose, (3, 1, 1)), [0, 0, 1.0], np.array([0, 0.4, np.pi]))
    np.testing.assert_allclose(rotation_distance(about_z, pose, None), [0, 0.4, np.pi], atol=1e-6)
    np.testing.assert_allclose(rotation_distance(about_z, pose, AXES[0]), 0, atol=1e-6)
    np.testing.assert_allclose(rotation_distance(about_z, pose, AXES[1]), [0, 0.4, np.pi],
                               atol=1e-6)


def test_same_mode_needs_place_and_orientation():
    pose = random_poses(1, 0)[0]
    poses = np.tile(pose, (5, 1, 1))
    poses[1, 0, 3] += 0.009
    poses[2, 0, 3] += 0.011
    poses[3] = spun(pose, AXES[1], 0.19)
    poses[4] = spun(pose, AXES[1], 0.21)
    np.testing.assert_array_equal(same_mode(poses, pose, None, 0.01, 0.2), [1, 1, 0, 1, 0])
    np.testing.assert_array_equal(same_mode(poses, pose, AXES[1], 0.01, 0.2), [1, 1, 0, 1, 1])


@pytest.mark.parametrize('axis', [None, AXES[0]], ids=['whole', 'symmetric'])
def test_levels_of_draws_from_the_covariance_are_uniform_and_heed_no_spin(axis):
    mean = random_poses(1, 3)[0]
    sigma = np.array([0.001, 0.002, 0.006, 0.02, 0.03, 0.01])
    basis = tangent_basis(mean, axis)
    spread = basis @ basis.T @ np.diag(sigma ** 2) @ basis @ basis.T
    rng = np.random.default_rng(0)
    draws = retract(mean, rng.multivariate_normal(np.zeros(6), spread, 1000, method='eigh'))
    np.testing.assert_allclose(tangent(draws, mean, axis) @ basis @ basis.T,
                               tangent(draws, mean, axis), atol=1e-9)
    if axis is not None:
        draws = spun(draws, axis, rng.uniform(0, 6, 1000))
        spread[3:, 3:] += FREE_AXIS_VARIANCE * np.outer(mean[:3, 2], mean[:3, 2])
    levels = np.sort([credible_level(each, mean, spread, axis) for each in draws])
    assert np.abs(levels - np.arange(1000) / 1000).max() < 0.06
    assert credible_level(mean, mean, spread, axis) == 0


@pytest.mark.parametrize('axis', [None, AXES[0]], ids=['whole', 'symmetric'])
def test_tangents_lead_back(axis):
    mean = random_poses(1, 1)[0]
    pose = retract(mean, np.array([[0.01, -0.02, 0.03, 0.1, -0.2, 0.15]]))
    back = retract(mean, tangent(pose, mean, axis))
    np.testing.assert_allclose(back[:, :3, 3], pose[:, :3, 3], atol=1e-12)
    assert rotation_distance(back, pose[0], axis)[0] < 1e-6
