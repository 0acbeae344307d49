"""Frames go round, covariances agree with samples, and an arm's history is what it was told."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.transforms import (
    about,
    covariance_at,
    inverse,
    transform,
    turned_covariance,
    without_spin,
)
from pmcl_ros.grasps.arm import ArmHistory
from pmcl_ros.grasps.gripper import GripperSettings
from pmcl_ros.grasps.settings import GraspSettings
from pmcl_ros.runtime.errors import GraspError

lengths = st.tuples(*[st.floats(-2, 2)] * 3)
SECOND = 1_000_000_000


@settings(max_examples=50, deadline=None)
@given(lengths, lengths, lengths, lengths)
def test_there_and_back(position, rpy, other, other_rpy):
    one, two = transform(position, rpy), transform(other, other_rpy)
    both = np.stack([one, two])
    np.testing.assert_allclose(inverse(both) @ both, np.tile(np.eye(4), (2, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(inverse(one @ two), inverse(two) @ inverse(one), atol=1e-12)


def test_roll_pitch_and_yaw_are_those_of_urdf():
    # about the fixed axes, roll first: R = Rz(yaw) Ry(pitch) Rx(roll)
    turn = transform((0, 0, 0), (0.1, 0.2, 0.3))[:3, :3]
    expected = (Rotation.from_rotvec([0, 0, 0.3]) * Rotation.from_rotvec([0, 0.2, 0])
                * Rotation.from_rotvec([0.1, 0, 0]))
    np.testing.assert_allclose(turn, expected.as_matrix(), atol=1e-12)


def test_the_default_mount_is_an_optical_frame_that_looks_along_the_wrist():
    mount = GraspSettings()
    camera = transform(mount.mount_position, mount.mount_rpy)[:3, :3]
    np.testing.assert_allclose(camera @ [0, 0, 1], [1, 0, 0], atol=1e-12)  # forward
    np.testing.assert_allclose(camera @ [0, 1, 0], [0, 0, -1], atol=1e-12)  # down


def test_the_parent_link_of_a_fetch_is_behind_its_fingers():
    parent = GripperSettings().parent_pose
    np.testing.assert_allclose(parent[:3, 3], [-0.16645, 0, 0])
    np.testing.assert_array_equal(parent[:3, :3], np.eye(3))


def test_turns_about_an_axis_leave_it():
    axis = np.array([1, 2, -2]) / 3
    turned = about(axis, np.array([0.0, 0.5, 3.0]))
    np.testing.assert_allclose(turned[:, :3, :3] @ axis, np.tile(axis, (3, 1)), atol=1e-12)
    assert np.arccos((np.trace(turned[1, :3, :3]) - 1) / 2) == pytest.approx(0.5)


def spread(seed=0):
    root = np.random.default_rng(seed).normal(size=(6, 6)) * np.repeat([2e-3, 1e-2], 3)[:, None]
    return root @ root.T


def test_the_shift_of_a_point_has_the_covariance_of_samples():
    rng, covariance, lever = np.random.default_rng(1), spread(), np.array([0.02, -0.05, 0.08])
    draws = rng.multivariate_normal(np.zeros(6), covariance, size=100_000)
    shifts = draws[:, :3] + Rotation.from_rotvec(draws[:, 3:]).apply(lever) - lever
    found = covariance_at(covariance, lever)
    np.testing.assert_allclose(found, np.cov(shifts.T), atol=0.03 * np.trace(found))
    many = covariance_at(covariance, np.stack([lever, 2 * lever, 0 * lever]))
    np.testing.assert_allclose(many[0], found)
    np.testing.assert_allclose(many[2], covariance[:3, :3])


def test_a_covariance_turns_with_its_frame():
    covariance, turn = spread(), Rotation.from_rotvec([0.3, -1, 0.4]).as_matrix()
    lever = np.array([0.02, -0.05, 0.08])
    turned = turned_covariance(covariance, turn)
    np.testing.assert_allclose(covariance_at(turned, turn @ lever),
                               turn @ covariance_at(covariance, lever) @ turn.T, atol=1e-15)


def test_a_spin_about_the_axis_counts_for_nothing():
    axis = np.array([0.6, 0, 0.8])
    covariance = spread()
    spun = covariance.copy()
    spun[3:, 3:] += np.pi ** 2 / 3 * np.outer(axis, axis)
    np.testing.assert_allclose(without_spin(spun, axis), without_spin(covariance, axis),
                               atol=1e-15)


def test_an_arm_is_where_it_was_between_two_poses():
    history = ArmHistory(0.1)
    first, last = transform((0, 0, 0)), transform((0.1, 0, 0), (0, 0, 0.4))
    history.add(SECOND + SECOND // 20, last)
    history.add(SECOND, first)  # out of order
    between = history.at(SECOND + SECOND // 40)
    np.testing.assert_allclose(between, transform((0.05, 0, 0), (0, 0, 0.2)), atol=1e-12)
    np.testing.assert_array_equal(history.at(SECOND), first)
    np.testing.assert_allclose(history.at(SECOND + SECOND // 20), last, atol=1e-12)
    np.testing.assert_array_equal(history.at(SECOND - SECOND // 20), first)


def test_a_pose_of_another_time_is_refused_with_the_times():
    history = ArmHistory(0.1)
    with pytest.raises(GraspError, match=r'no pose of the arm.*arm_pose'):
        history.at(SECOND)
    history.add(SECOND, np.eye(4))
    with pytest.raises(GraspError, match=r'1\.500 s older.*0\.1 s.*max_age'):
        history.at(SECOND * 5 // 2)
    with pytest.raises(GraspError, match=r'0\.500 s newer'):
        history.at(SECOND // 2)
    history.add(3 * SECOND, transform((1, 0, 0)))  # too far for anything between
    np.testing.assert_array_equal(history.at(3 * SECOND - 1000), transform((1, 0, 0)))
    with pytest.raises(GraspError, match=r'1\.000 s'):
        history.at(2 * SECOND)


def test_old_poses_are_forgotten_and_so_are_all_when_the_clock_is_set_back():
    history = ArmHistory(0.1, kept=2.0)
    for second in range(6):
        history.add(second * SECOND, transform((second, 0, 0)))
    history.at(4 * SECOND)
    with pytest.raises(GraspError, match=r'0\.500 s newer'):
        history.at(5 * SECOND // 2)
    history.add(SECOND, transform((7, 0, 0)))
    assert history.at(SECOND)[0, 3] == 7
    with pytest.raises(GraspError):
        history.at(5 * SECOND)
