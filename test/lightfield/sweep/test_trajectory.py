"""Poses between those that were told."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sweep_scene import pose_at

from pmcl_ros.lightfield.sweep.trajectory import Trajectory
from pmcl_ros.runtime.errors import LightFieldError

SECOND = 1_000_000_000


@given(st.integers(0, 2 ** 32 - 1), st.integers(1, SECOND - 1))
def test_an_even_screwless_way_is_followed_exactly(seed, at):
    rng = np.random.default_rng(seed)
    way, axis = rng.normal(0, 1, 3), rng.normal(0, 1, 3)
    start = pose_at(*rng.normal(0, 1, 3), Rotation.random(rng=rng).as_rotvec(degrees=True))

    def true(stamp_ns):
        pose = start.copy()
        pose[:3, 3] += way * stamp_ns / 1e9
        pose[:3, :3] = start[:3, :3] @ Rotation.from_rotvec(axis * stamp_ns / 1e9).as_matrix()
        return pose

    trajectory = Trajectory(gap=0.11)
    for tenth in rng.permutation(11):  # they may come in any order
        trajectory.add(int(tenth) * SECOND // 10, true(int(tenth) * SECOND // 10))
    moving = trajectory.at(at)
    np.testing.assert_allclose(moving.pose, true(at), atol=1e-9)
    assert moving.speed == pytest.approx(np.linalg.norm(way))
    assert moving.turning == pytest.approx(np.linalg.norm(axis))


def test_what_will_not_come_is_told():
    trajectory = Trajectory(gap=0.2)
    assert trajectory.at(5 * SECOND) is None
    trajectory.add(10 * SECOND, pose_at(0))
    trajectory.add(11 * SECOND, pose_at(1))
    with pytest.raises(LightFieldError, match=r'poses begin 5\.000 s after it'):
        trajectory.at(5 * SECOND)
    with pytest.raises(LightFieldError, match=r'about it are 1\.000 s apart, at most 0\.2 s'):
        trajectory.at(10 * SECOND + 1)
    assert trajectory.at(11 * SECOND + 1) is None
    # one of the very stamp needs no other; poses far from it do not tell its speed
    assert trajectory.at(11 * SECOND).pose[0, 3] == 1
    assert trajectory.at(11 * SECOND).speed == 0
    trajectory.add(11 * SECOND + SECOND // 10, pose_at(1.1))
    assert trajectory.at(11 * SECOND).speed == pytest.approx(1)


def test_old_poses_and_those_of_another_clock_are_forgotten():
    trajectory = Trajectory(gap=0.2, kept=10)
    for second in (0, 5, 100):
        trajectory.add(second * SECOND, pose_at(second))
    with pytest.raises(LightFieldError, match='begin 95'):
        trajectory.at(5 * SECOND)
    trajectory.add(50 * SECOND, pose_at(7))
    assert trajectory.at(50 * SECOND).pose[0, 3] == 7
    assert trajectory.at(100 * SECOND) is None
