"""Corners measured on the sensor's pixels, against where the rays of a known camera put them."""

import functools

import numpy as np
import pytest
from board_scene import POSES, SIDE, frame_of
from board_scene import plain as scene

from pmcl_ros.lightfield.calibration.lytro.corners import CornerMeter
from pmcl_ros.lightfield.white_image import relative_light

POSE = POSES[1]


@functools.cache
def meter():
    return CornerMeter(scene().calibration.lattice, relative_light(scene().white()))


def errors(corners, pose=POSE):
    positions, disparities = scene().corners(pose)
    return np.concatenate([corners.positions - positions, corners.disparities - disparities],
                          axis=-1)


def measured(frame, pose=POSE, start=(0.3, -0.25, 0.04, -0.03)):
    positions, disparities = scene().corners(pose)
    return meter().measure(frame, positions + start[:2], disparities + start[2:])


@pytest.mark.parametrize('index', [1, 3])
def test_corners_are_as_good_as_the_noise_allows(index):
    pose = POSES[index]
    corners = measured(frame_of(index), pose)
    off = errors(corners, pose)
    assert corners.valid.all()
    assert np.abs(off).max() < 0.01
    normal = np.linalg.solve(corners.covariances, off[..., None])[..., 0]
    squares = (normal * off).sum(axis=-1)  # of four degrees of freedom each
    assert 2 < squares.mean() < 8
    assert np.abs(off.mean(axis=(0, 1)) * np.sqrt(off.shape[0] * off.shape[1])
                  / off.std(axis=(0, 1))).max() < 4  # no bias, of the disparity either


def test_the_start_does_not_matter():
    frame = frame_of(1)
    one, other = measured(frame), measured(frame, start=(-0.2, 0.3, -0.05, 0.05))
    # As the window moves with the start, other pixels count.
    sigma = np.sqrt(np.diagonal(one.covariances, axis1=-2, axis2=-1))
    assert np.abs(errors(one) - errors(other)).max() < 3 * sigma.max()


def test_a_tinted_light_changes_nothing():
    values = scene().reflectance(POSE) * scene().light
    tint = np.ones((SIDE, SIDE))
    tint[::2, ::2], tint[1::2, 1::2] = 0.6, 1.3
    plain = errors(measured(scene().frame(values, seed=1)))
    tinted = errors(measured(scene().frame(values * tint, seed=1)))
    assert np.abs(tinted).max() < 2 * np.abs(plain).max() + 0.002


def test_contrasts_tell_which_squares_are_light():
    contrasts = measured(frame_of(1)).contrasts
    row, column = np.indices(contrasts.shape)
    assert (np.sign(contrasts) == (-1) ** (row + column)).all()
    assert np.abs(np.abs(contrasts) - 0.26).max() < 0.04


def test_a_covered_corner_is_not_measured_or_not_trusted():
    values = scene().reflectance(POSE) * scene().light
    positions, _ = scene().corners(POSE)
    x, y = np.rint(positions[2, 3] * 10 + 4.5).astype(int)
    values[y - 45:y + 45, x - 45:x + 45] = 0.3 * scene().light[y - 45:y + 45, x - 45:x + 45]
    corners = measured(scene().frame(values))
    sigma = np.sqrt(np.trace(corners.covariances[2, 3]))
    usual = np.sqrt(np.trace(corners.covariances[0, 0]))
    assert not corners.valid[2, 3] or sigma > 5 * usual
    assert np.abs(errors(corners)[0]).max() < 0.01


def test_turned_twice_is_the_same():
    corners = measured(frame_of(1))
    twice = corners.turned().turned()
    assert (twice.positions == corners.positions).all()
    assert (corners.turned().contrasts[0, 0] == corners.contrasts[-1, -1])
