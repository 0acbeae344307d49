"""Epipolar distances and parallaxes of matches, against plain geometry."""

import numpy as np
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.epipolar import parallax, sampson
from pmcl_ros.geometry.se3 import pose_of

BETWEEN = pose_of(Rotation.from_rotvec([0.02, 0.21, 0.01]), [-0.12, 0.01, 0.02])


def test_the_distance_is_that_from_the_epipolar_line():
    """To first order; where both are equally far from their lines, 1 / sqrt(2) of that."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.1, -0.1, 0.5], [0.1, 0.1, 0.7], (50, 3))
    other = points @ BETWEEN[:3, :3].T + BETWEEN[:3, 3]
    rays = np.stack([points / points[:, 2:], other / other[:, 2:]], axis=1)
    many = np.tile(BETWEEN, (50, 1, 1))
    np.testing.assert_allclose(sampson(rays, many), 0, atol=1e-12)
    essential = np.array([np.cross(BETWEEN[:3, 3], BETWEEN[:3, :3][:, k]) for k in range(3)]).T
    line = rays[:, 0] @ essential.T
    across = line[:, :2] / np.linalg.norm(line[:, :2], axis=1, keepdims=True)
    moved = rays.copy()
    moved[:, 1, :2] += 1e-4 * across
    back = moved[:, 1] @ essential
    share = np.square(line[:, :2]).sum(axis=1)
    expected = 1e-4 * np.sqrt(share / (share + np.square(back[:, :2]).sum(axis=1)))
    np.testing.assert_allclose(sampson(moved, many), expected, rtol=1e-3)
    assert (sampson(rays, np.eye(4)[None]) == 0).all()  # of one place there is no line


def test_the_parallax_is_negative_behind_the_cameras():
    rng = np.random.default_rng(0)
    ahead = rng.uniform([-0.1, -0.1, 0.5], [0.1, 0.1, 0.7], (50, 3))
    for points, sign in ((ahead, 1), (-ahead, -1)):
        other = points @ BETWEEN[:3, :3].T + BETWEEN[:3, 3]
        rays = np.stack([points / points[:, 2:], other / other[:, 2:]], axis=1)
        one = rays[:, 0] @ BETWEEN[:3, :3].T
        cosines = (one * rays[:, 1]).sum(axis=1) / np.linalg.norm(one, axis=1) / np.linalg.norm(
            rays[:, 1], axis=1)
        np.testing.assert_allclose(parallax(rays, BETWEEN), sign * np.arccos(cosines), atol=1e-7)
    assert (parallax(rays, np.eye(4)) >= 0).all()  # of one place nothing is behind
