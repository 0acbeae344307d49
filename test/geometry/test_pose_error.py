import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pose_error import is_right, pose_error
from pmcl_ros.geometry.symmetry import Symmetry

AXIS = np.array([0, 0, 1.0])
VECTORS = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)
DIRECTIONS = VECTORS.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))
ANGLES = st.floats(0, np.pi)


def pose(rotation, x=0.1, y=-0.2, z=0.6):
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.as_matrix()
    matrix[:3, 3] = x, y, z
    return matrix


ROTATIONS = VECTORS.map(lambda v: Rotation.from_rotvec(3 * v))


@settings(deadline=None)
@given(ROTATIONS, DIRECTIONS, ANGLES)
def test_rotation_is_the_angle_between(rotation, direction, angle):
    turned = Rotation.from_rotvec(angle * direction) * rotation
    error = pose_error(pose(turned), pose(rotation), Symmetry())
    assert error.rotation == pytest.approx(angle, abs=1e-6)
    assert (error.translation, error.ray) == (0, 0)


@settings(deadline=None)
@given(ROTATIONS, DIRECTIONS, ANGLES, DIRECTIONS, st.floats(0.1, 9))
def test_turns_about_the_axis_of_symmetry_do_not_count(rotation, axis, angle, other, length):
    turned = rotation * Rotation.from_rotvec(angle * axis)
    assert pose_error(pose(turned), pose(rotation), Symmetry(length * axis)).rotation < 1e-6
    # nor do they add to a tilt of the axis
    tilt = np.cross(axis, other)
    if np.linalg.norm(tilt) > 0.1:
        tilted = rotation * Rotation.from_rotvec(angle * tilt / np.linalg.norm(tilt))
        spun = tilted * Rotation.from_rotvec(2.0 * axis)
        found = pose_error(pose(spun), pose(rotation), Symmetry(axis)).rotation
        assert found == pytest.approx(angle, abs=1e-6)


@pytest.mark.parametrize('axis', [None, AXIS])
@pytest.mark.parametrize(('degrees', 'flipped'),
                         [(0, False), (89, False), (91, True), (180, True)])
def test_flipped_is_more_than_half_way_over(axis, degrees, flipped):
    turned = Rotation.from_rotvec([np.deg2rad(degrees), 0, 0])
    error = pose_error(pose(turned), pose(Rotation.identity()), Symmetry(axis))
    assert error.flipped is flipped
    assert np.rad2deg(error.rotation) == pytest.approx(degrees, abs=1e-4)


@settings(deadline=None)
@given(VECTORS, st.floats(-0.3, 0.3), VECTORS)
def test_ray_is_the_signed_part_along_the_line_of_sight(place, along, across):
    truth = pose(Rotation.identity(), *place + np.array([0, 0, 2]))
    sight = truth[:3, 3] / np.linalg.norm(truth[:3, 3])
    across = across - sight * (across @ sight)
    found = truth.copy()
    found[:3, 3] += along * sight + across
    error = pose_error(found, truth, Symmetry(AXIS))
    assert error.ray == pytest.approx(along, abs=1e-9)  # positive: too far
    assert error.translation == pytest.approx(np.hypot(along, np.linalg.norm(across)), abs=1e-9)
    assert error.rotation == 0


@settings(deadline=None)
@given(ROTATIONS, DIRECTIONS, ANGLES)
def test_of_truths_that_are_alike_the_nearest_counts(rotation, direction, angle):
    half = np.stack([np.eye(4), np.diag([1.0, -1, -1, 1])])  # upside down is the same
    turned = pose(Rotation.from_rotvec(angle * direction) * rotation)
    for axis in (None, AXIS):
        error = pose_error(turned, pose(rotation), Symmetry(axis, half))
        flipped = pose_error(turned @ half[1], pose(rotation), Symmetry(axis, half))
        assert error.rotation == pytest.approx(flipped.rotation, abs=1e-6)
        plain = pose_error(turned, pose(rotation), Symmetry(axis))
        assert error.rotation <= plain.rotation + 1e-9
        if axis is not None:
            assert error.rotation == pytest.approx(min(plain.rotation, np.pi - plain.rotation),
                                                   abs=1e-6)
            assert abs(error.dot) == pytest.approx(abs(plain.dot), abs=1e-6)
            assert not error.flipped or plain.rotation == pytest.approx(np.pi / 2)


@settings(deadline=None)
@given(ROTATIONS, ROTATIONS)
def test_dot_is_that_of_the_axes(first, second):
    dot = pose(first)[:3, 2] @ pose(second)[:3, 2]
    error = pose_error(pose(first), pose(second), Symmetry(AXIS))
    assert error.dot == pytest.approx(dot, abs=1e-9)


def test_right_is_below_two_centimetres_and_ten_degrees():
    turn = Rotation.from_rotvec([np.deg2rad(9.9), 0, 0])
    assert pose_error(pose(turn, 0.119), pose(Rotation.identity()), Symmetry()).right
    assert not pose_error(pose(turn, 0.121), pose(Rotation.identity()), Symmetry()).right
    assert not is_right(0.019, np.deg2rad(10.1))
