"""Inverses and interpolation of poses; covariances agree with samples."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import (
    covariance_at,
    inverse,
    least_turn,
    local,
    point_covariance,
    remove_spin,
    retract,
    rotate_covariance,
    rotations_about,
    transform,
)
from pmcl_ros.grasps.settings import GraspSettings, GripperSettings

lengths = st.tuples(*[st.floats(-2, 2)] * 3)


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
    turned = rotations_about(axis, np.array([0.0, 0.5, 3.0]))
    np.testing.assert_allclose(turned[:, :3, :3] @ axis, np.tile(axis, (3, 1)), atol=1e-12)
    assert np.arccos((np.trace(turned[1, :3, :3]) - 1) / 2) == pytest.approx(0.5)


def spread(seed=0):
    root = np.random.default_rng(seed).normal(size=(6, 6)) * np.repeat([2e-3, 1e-2], 3)[:, None]
    return root @ root.T


def test_the_shift_of_a_point_has_the_covariance_of_samples():
    rng, covariance, lever = np.random.default_rng(1), spread(), np.array([0.02, -0.05, 0.08])
    draws = rng.multivariate_normal(np.zeros(6), covariance, size=100_000)
    shifts = draws[:, :3] + Rotation.from_rotvec(draws[:, 3:]).apply(lever) - lever
    found = point_covariance(covariance, lever)
    np.testing.assert_allclose(found, np.cov(shifts.T), atol=0.03 * np.trace(found))
    many = point_covariance(covariance, np.stack([lever, 2 * lever, 0 * lever]))
    np.testing.assert_allclose(many[0], found)
    np.testing.assert_allclose(many[2], covariance[:3, :3])


def test_a_covariance_turns_with_its_frame():
    covariance, turn = spread(), Rotation.from_rotvec([0.3, -1, 0.4]).as_matrix()
    lever = np.array([0.02, -0.05, 0.08])
    turned = rotate_covariance(covariance, turn)
    np.testing.assert_allclose(point_covariance(turned, turn @ lever),
                               turn @ point_covariance(covariance, lever) @ turn.T, atol=1e-15)


def test_a_spin_about_the_axis_counts_for_nothing():
    axis = np.array([0.6, 0, 0.8])
    covariance = spread()
    spun = covariance.copy()
    spun[3:, 3:] += np.pi ** 2 / 3 * np.outer(axis, axis)
    rest = remove_spin(covariance, axis)
    np.testing.assert_allclose(remove_spin(spun, axis), rest, atol=1e-15)
    np.testing.assert_allclose(rest, rest.T, atol=1e-15)
    np.testing.assert_allclose(rest[:, 3:] @ axis, 0, atol=1e-15)


directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda each: np.linalg.norm(each) > 1e-3)


@settings(max_examples=100, deadline=None)
@given(directions, directions, st.sampled_from([None, 0.0, 1e-9, 1e-5]))
def test_the_least_turn_takes_one_direction_to_another_by_the_angle_between_them(
        start, end, nearly):
    start, end = np.array(start), np.array(end)
    if nearly is not None:  # opposite, or nearly so
        end = -2 * start + nearly * end
    turn = least_turn(start, end)
    unit = [each / np.linalg.norm(each) for each in (start, end)]
    np.testing.assert_allclose(turn.apply(unit[0]), unit[1], atol=1e-12)
    angle = 2 * np.arctan2(np.linalg.norm(unit[0] - unit[1]), np.linalg.norm(sum(unit)))
    assert turn.magnitude() == pytest.approx(angle, abs=1e-9)


def test_no_deviations_move_no_poses():
    assert retract(np.eye(4), np.zeros((0, 6))).shape == (0, 4, 4)
    assert local(np.zeros((0, 4, 4)), np.eye(4)).shape == (0, 6)


def test_a_covariance_at_another_point_is_that_of_samples_there():
    rng = np.random.default_rng(4)
    spread = rng.normal(size=(6, 6))
    spread = spread @ spread.T * 1e-6
    pose, point = transform((0.1, 0.2, 0.5), (0.3, -0.4, 1)), transform((0.03, 0.05, -0.1))
    samples = retract(pose, rng.multivariate_normal(np.zeros(6), spread, 200_000))
    there = pose @ point
    found = np.cov(local(samples @ point, there).T)
    np.testing.assert_allclose(covariance_at(spread, there[:3, 3] - pose[:3, 3]), found,
                               atol=0.02 * np.abs(found).max())
