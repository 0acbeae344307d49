import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from pmcl_ros.pmcl.particles import perturb, uniform_poses
from pmcl_ros.pmcl.region import Region

REGION = Region((0.1, -0.2, 0.6), (0.2, 0.1, 0.05))
COUNT = 20_000


def assert_poses(poses):
    turns = poses[:, :3, :3]
    identity = np.broadcast_to(np.eye(3), turns.shape)
    np.testing.assert_allclose(turns @ turns.swapaxes(1, 2), identity, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1)
    np.testing.assert_array_equal(poses[:, 3], np.broadcast_to([0, 0, 0, 1], (len(poses), 4)))


def test_positions_are_uniform_in_the_region():
    poses = uniform_poses(REGION, COUNT, np.random.default_rng(0))
    assert_poses(poses)
    assert REGION.contains(poses[:, :3, 3]).all()
    unit = (poses[:, :3, 3] - REGION.center) / REGION.size + 0.5
    for axis in unit.T:
        assert kstest(axis, 'uniform').pvalue > 1e-3
    np.testing.assert_allclose(np.corrcoef(unit.T), np.eye(3), atol=0.03)


def test_orientations_are_uniform_over_all_rotations():
    turns = uniform_poses(REGION, COUNT, np.random.default_rng(1))[:, :3, :3]
    for axis in range(3):
        # By Archimedes each coordinate of a uniform direction is uniform.
        for coordinate in turns[:, :, axis].T:
            assert kstest(coordinate, 'uniform', (-1, 2)).pvalue > 1e-3
    # The angle of a uniform rotation has density (1 - cos) / pi.
    angle = Rotation.from_matrix(turns).magnitude()
    assert kstest(angle, lambda a: (a - np.sin(a)) / np.pi).pvalue > 1e-3


def test_the_same_seed_gives_the_same_poses():
    first, second = (uniform_poses(REGION, 9, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_perturbation_is_gaussian_with_its_deviations_about_the_camera_axes():
    poses = uniform_poses(REGION, COUNT, np.random.default_rng(2))
    before = poses.copy()
    along, about = np.array([0.001, 0.002, 0.01]), np.array([0.03, 0.01, 0.002])
    moved = perturb(poses, along, about, np.random.default_rng(3))
    np.testing.assert_array_equal(poses, before)
    assert_poses(moved)
    turn = Rotation.from_matrix(moved[:, :3, :3] @ poses[:, :3, :3].swapaxes(1, 2)).as_rotvec()
    deviations = np.hstack([moved[:, :3, 3] - poses[:, :3, 3], turn]) / np.hstack([along, about])
    for each in deviations.T:
        assert kstest(each, 'norm').pvalue > 1e-3
    np.testing.assert_allclose(np.cov(deviations.T), np.eye(6), atol=0.05)


def test_no_deviation_is_no_motion():
    poses = uniform_poses(REGION, 50, np.random.default_rng(4))
    np.testing.assert_allclose(perturb(poses, 0.0, 0.0, np.random.default_rng(5)), poses,
                               atol=1e-15)
