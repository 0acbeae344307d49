"""Chains of transforms over time: as if the frames were composed by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import interpolate
from pmcl_ros.geometry.transform_tree import TransformTree
from pmcl_ros.runtime.errors import PoseUnavailableError

SECOND = 1_000_000_000


def pose(seed):
    made = np.eye(4)
    made[:3, :3] = Rotation.random(None, np.random.default_rng(seed)).as_matrix()
    made[:3, 3] = np.random.default_rng(seed).normal(size=3)
    return made


@pytest.fixture
def tree():
    """world <- base (fixed), base <- arm and base <- head (moving), arm <- camera (fixed)."""
    made = TransformTree()
    made.add('world', 'base', pose(0))
    made.add('arm', 'camera', pose(1))
    for second, seed in enumerate((2, 3)):
        made.add('base', 'arm', pose(seed), (1 + second) * SECOND)
        made.add('base', 'head', pose(seed + 2), (1 + second) * SECOND)
    return made


def test_a_chain_is_composed_up_and_down(tree):
    arm, head = interpolate(pose(2), pose(3), 0.25), interpolate(pose(4), pose(5), 0.25)
    for frame, expected in (('world', pose(0) @ arm @ pose(1)), ('base', arm @ pose(1)),
                            ('head', np.linalg.inv(head) @ arm @ pose(1)),
                            ('camera', np.eye(4))):
        found = tree.interpolated(5 * SECOND // 4, frame, 'camera', 2)
        np.testing.assert_allclose(found.pose, expected, atol=1e-12)
    back = tree.interpolated(5 * SECOND // 4, 'camera', 'world', 2)
    np.testing.assert_allclose(back.pose, np.linalg.inv(pose(0) @ arm @ pose(1)), atol=1e-12)


def test_the_speed_is_that_of_the_motion(tree):
    found = tree.interpolated(5 * SECOND // 4, 'base', 'arm', 2)
    assert found.speed == pytest.approx(np.linalg.norm(pose(3)[:3, 3] - pose(2)[:3, 3]))
    turn = Rotation.from_matrix(pose(2)[:3, :3].T @ pose(3)[:3, :3])
    assert found.angular_speed == pytest.approx(turn.magnitude())
    fixed = tree.interpolated(7 * SECOND, 'arm', 'camera', 2)  # at any time
    assert (fixed.speed, fixed.angular_speed) == (0, 0)


def test_where_the_poses_begin_the_speed_is_that_after_it(tree):
    first, later = (tree.interpolated(each, 'base', 'arm', 2)
                    for each in (SECOND, 5 * SECOND // 4))
    np.testing.assert_allclose(first.pose, pose(2), atol=1e-12)
    assert (first.speed, first.angular_speed) == pytest.approx(
        (later.speed, later.angular_speed))
    with pytest.raises(PoseUnavailableError, match=r'first pose is 0\.001 s newer'):
        tree.interpolated(999 * SECOND // 1000, 'base', 'arm', 2)


def test_a_pose_that_is_known_needs_no_speed():
    tree = TransformTree()
    for stamp, seed in ((0, 0), (SECOND // 50, 1)):
        tree.add('base', 'arm', pose(seed), stamp)
    found = tree.interpolated(SECOND // 100, 'base', 'arm', 2)
    np.testing.assert_allclose(found.pose, interpolate(pose(0), pose(1), 0.5), atol=1e-12)
    assert (found.speed, found.angular_speed) == (0, 0)


def test_no_pose_is_forgotten_and_no_clock_is_set():
    tree = TransformTree()
    for stamp, seed in ((10 ** 18, 0), (10 ** 18 + SECOND, 1), (0, 2)):
        tree.add('base', 'arm', pose(seed), stamp)
    np.testing.assert_allclose(tree.interpolated(10 ** 18, 'base', 'arm', 2).pose, pose(0),
                               atol=1e-12)


def test_what_is_not_known_is_told(tree):
    assert tree.interpolated(3 * SECOND, 'base', 'camera', 2) is None  # it may still come
    with pytest.raises(PoseUnavailableError, match=r'at most 0\.5 s are allowed'):
        tree.interpolated(5 * SECOND // 4, 'base', 'camera', 0.5)
    with pytest.raises(PoseUnavailableError, match="joins 'eye' to 'base': there are arm, base"):
        tree.interpolated(SECOND, 'base', 'eye', 2)
    with pytest.raises(PoseUnavailableError, match="'camera' is in 'arm', then in 'head'"):
        tree.add('head', 'camera', pose(0))
    tree.add('camera', 'world', pose(6))
    with pytest.raises(PoseUnavailableError, match='is its own ancestor'):
        tree.interpolated(SECOND, 'base', 'camera', 2)
