"""The pose at a time, from poses at other times."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sweep_scene import pose_at

from pmcl_ros.geometry.pose_buffer import PoseBuffer
from pmcl_ros.geometry.se3 import transform
from pmcl_ros.runtime.errors import PoseUnavailableError

SECOND = 1_000_000_000


@given(st.integers(0, 2 ** 32 - 1), st.integers(1, SECOND - 1))
def test_an_even_screwless_way_is_followed_exactly(seed, at):
    rng = np.random.default_rng(seed)
    way, axis = rng.normal(0, 1, 3), rng.normal(0, 1, 3)
    start = pose_at(*rng.normal(0, 1, 3), Rotation.random(None, rng).as_rotvec(degrees=True))

    def true(stamp_ns):
        pose = start.copy()
        pose[:3, 3] += way * stamp_ns / 1e9
        pose[:3, :3] = start[:3, :3] @ Rotation.from_rotvec(axis * stamp_ns / 1e9).as_matrix()
        return pose

    buffer = PoseBuffer()
    for tenth in rng.permutation(11):  # they may come in any order
        buffer.add(int(tenth) * SECOND // 10, true(int(tenth) * SECOND // 10))
    moving = buffer.interpolated(at, 0.11)
    np.testing.assert_allclose(moving.pose, true(at), atol=1e-9)
    assert moving.speed == pytest.approx(np.linalg.norm(way))
    assert moving.angular_speed == pytest.approx(np.linalg.norm(axis))


def test_a_pose_that_will_not_come_is_refused():
    buffer = PoseBuffer()
    assert buffer.interpolated(5 * SECOND, 0.2) is None
    buffer.add(10 * SECOND, pose_at(0))
    buffer.add(11 * SECOND, pose_at(1))
    with pytest.raises(PoseUnavailableError, match=r'first pose is 5\.000 s newer.* 5000000000'):
        buffer.interpolated(5 * SECOND, 0.2)
    with pytest.raises(PoseUnavailableError, match=r'are 1\.000 s apart, at most 0\.2 s'):
        buffer.interpolated(10 * SECOND + 1, 0.2)
    assert buffer.interpolated(10 * SECOND + 1, 1).speed == pytest.approx(1)  # 1 s is allowed
    assert buffer.interpolated(11 * SECOND + 1, 0.2) is None
    # a pose of that very stamp needs no other; poses far from it give no speed
    assert buffer.interpolated(11 * SECOND, 0.2).pose[0, 3] == 1
    assert buffer.interpolated(11 * SECOND, 0.2).speed == 0
    buffer.add(11 * SECOND + SECOND // 10, pose_at(1.1))
    assert buffer.interpolated(11 * SECOND, 0.2).speed == pytest.approx(1)
    assert buffer.interpolated(11 * SECOND + SECOND // 10, 0.2).speed == pytest.approx(1)
    buffer.add(11 * SECOND, pose_at(7))  # the newer one of a stamp counts
    assert buffer.interpolated(11 * SECOND, 0.2).pose[0, 3] == 7


@pytest.mark.parametrize('order', [1, -1])
def test_where_an_arm_starts_or_stops_it_moves(order):
    buffer = PoseBuffer()
    ways = [pose_at(0), pose_at(0), pose_at(0.1, turn=(0, 0, 5))]
    for tenth, pose in enumerate(ways[::order]):
        buffer.add(tenth * SECOND // 10, pose)
    moving = buffer.interpolated(SECOND // 10, 0.2)
    assert (moving.speed, moving.angular_speed) == pytest.approx((1, np.deg2rad(50)))


def test_old_poses_and_those_of_another_clock_are_forgotten():
    buffer = PoseBuffer(10)
    for second in (0, 5, 100):
        buffer.add(second * SECOND, pose_at(second))
    with pytest.raises(PoseUnavailableError, match='first pose is 95'):
        buffer.interpolated(5 * SECOND, 0.2)
    buffer.add(50 * SECOND, pose_at(7))
    assert buffer.interpolated(50 * SECOND, 0.2).pose[0, 3] == 7
    assert buffer.interpolated(100 * SECOND, 0.2) is None


def test_an_arm_is_where_it_was_between_two_poses():
    buffer = PoseBuffer()
    first, last = transform((0, 0, 0)), transform((0.1, 0, 0), (0, 0, 0.4))
    buffer.add(SECOND + SECOND // 20, last)
    buffer.add(SECOND, first)  # out of order
    between = buffer.nearest(SECOND + SECOND // 40, 0.1)
    np.testing.assert_allclose(between, transform((0.05, 0, 0), (0, 0, 0.2)), atol=1e-12)
    np.testing.assert_array_equal(buffer.nearest(SECOND, 0.1), first)
    np.testing.assert_allclose(buffer.nearest(SECOND + SECOND // 20, 0.1), last, atol=1e-12)
    np.testing.assert_array_equal(buffer.nearest(SECOND - SECOND // 20, 0.1), first)


def test_a_pose_of_another_time_is_refused_with_the_times():
    buffer = PoseBuffer()
    with pytest.raises(PoseUnavailableError, match='no pose has come'):
        buffer.nearest(SECOND, 0.1)
    buffer.add(SECOND, np.eye(4))
    with pytest.raises(PoseUnavailableError, match=r'1\.500 s older, at most 0\.1 s'):
        buffer.nearest(SECOND * 5 // 2, 0.1)
    with pytest.raises(PoseUnavailableError, match=r'0\.500 s newer'):
        buffer.nearest(SECOND // 2, 0.1)
    buffer.add(3 * SECOND, transform((1, 0, 0)))  # too far for anything between
    np.testing.assert_array_equal(buffer.nearest(3 * SECOND - 1000, 0.1), transform((1, 0, 0)))
    with pytest.raises(PoseUnavailableError, match=r'1\.000 s'):
        buffer.nearest(2 * SECOND, 0.1)


def test_the_nearest_pose_is_no_old_one_and_none_when_the_clock_is_set_back():
    buffer = PoseBuffer(2.0)
    for second in range(6):
        buffer.add(second * SECOND, transform((second, 0, 0)))
    buffer.nearest(4 * SECOND, 0.1)
    with pytest.raises(PoseUnavailableError, match=r'0\.500 s newer'):
        buffer.nearest(5 * SECOND // 2, 0.1)
    buffer.add(SECOND, transform((7, 0, 0)))
    assert buffer.nearest(SECOND, 0.1)[0, 3] == 7
    with pytest.raises(PoseUnavailableError):
        buffer.nearest(5 * SECOND, 0.1)


def test_a_clock_that_is_set_back_a_minute_begins_anew():
    buffer = PoseBuffer()
    for tick in range(600):
        buffer.add(tick * SECOND // 10, transform((1, 0, 0)))
    for tick in range(30):
        buffer.add(tick * SECOND // 10 + 7, transform((0, 0, 0)))
        assert buffer.nearest(tick * SECOND // 10, 0.5)[0, 3] == 0
    with pytest.raises(PoseUnavailableError):
        buffer.nearest(30 * SECOND, 0.5)


def test_a_capture_without_a_stamp_is_told():
    buffer = PoseBuffer()
    buffer.add(SECOND, pose_at(0))
    with pytest.raises(PoseUnavailableError, match='has the stamp 0, which is no time'):
        buffer.interpolated(0, 0.2)
