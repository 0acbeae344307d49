"""Checkerboards in single pictures, and what is none."""

import cv2
import numpy as np
import pytest
from painted_boards import painted, picture_of_board
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.subpixel import refined
from pmcl_ros.runtime.errors import SettingsError


def test_corners_and_square_are_read():
    assert Checkerboard.parse('10x7', 0.011) == Checkerboard(10, 7, 0.011)
    assert Checkerboard.parse(' 5 X 4 ', 0.02) == Checkerboard(5, 4, 0.02)


@pytest.mark.parametrize(('corners', 'square'), [
    ('10', 0.01), ('10x', 0.01), ('-3x7', 0.01), ('2x7', 0.01), ('10x7x2', 0.01), ('999x7', 0.01),
    ('10x7', 0.0), ('10x7', 11.0), ('10x7', float('nan'))])
def test_an_impossible_board_is_refused(corners, square):
    with pytest.raises(SettingsError, match=r'x7|corners|squares'):
        Checkerboard.parse(corners, square)


@pytest.mark.parametrize('part', [(9, 6), (10, 5), (6, 7), (5, 4)])
def test_a_part_of_a_board_is_none(part):
    """Which part, or each second corner, differed from picture to picture."""
    board, rng = Checkerboard(10, 7, 0.02), np.random.default_rng(3)
    pinhole = Pinhole(640, 480, 600, 600, 322, 238)
    for _ in range(4):
        turn = Rotation.from_euler('xyz', [*rng.uniform(-35, 35, 2), rng.uniform(-30, 30)],
                                   degrees=True).as_matrix()
        picture = picture_of_board(board, pose_of(
            turn, [0, 0, 0.5] - turn @ board.points.mean(axis=0)), pinhole)
        assert board.seen(picture) is not None
        assert Checkerboard(*part, 0.02).seen(picture) is None


def test_a_board_half_in_shadow_before_a_striped_cloth_is_seen():
    board, pinhole = Checkerboard(10, 7, 0.02), Pinhole(640, 480, 600, 600, 322, 238)
    turn = Rotation.from_euler('xyz', [25, -15, 8], degrees=True).as_matrix()
    pose = pose_of(turn, [0, 0, 0.5] - turn @ board.points.mean(axis=0))
    stripes = np.where(np.arange(640) // 24 % 2, 40, 220)
    picture = painted(np.tile(stripes.astype(np.uint8), (480, 1)), board, pose, pinhole)
    picture[:, 330:] //= 3
    off = board.seen(picture) - pinhole.project(board.points @ turn.T + pose[:3, 3])
    assert np.abs(off).max() < 0.5


def test_corners_in_reverse_are_refined_alike():
    board, pinhole = Checkerboard(10, 7, 0.02), Pinhole(640, 480, 600, 600, 322, 238)
    pose = pose_of(np.eye(3), [0, 0, 0.5] - board.points.mean(axis=0))
    exact = pinhole.project(board.points + pose[:3, 3])
    picture, plane = picture_of_board(board, pose, pinhole), board.points[:, :2] / board.square
    near = exact + np.random.default_rng(0).normal(0, 0.05, exact.shape)
    found = refined(picture, near, plane, 0.45)
    backwards = refined(picture, near[::-1].copy()[::-1], plane, 0.45)  # a view of another order
    np.testing.assert_array_equal(found, backwards)
    assert np.abs(found - exact).max() < 0.1


@pytest.mark.parametrize('side', [320, 1280])
def test_corners_in_a_picture_have_no_common_error(side):
    board, rng = Checkerboard(10, 7, 0.02), np.random.default_rng(2)
    pinhole = Pinhole(side, 3 * side // 4, 0.9 * side, 0.9 * side, side / 2, 0.4 * side)
    for _ in range(6):
        turn = Rotation.from_euler('xyz', [*rng.uniform(-35, 35, 2), rng.uniform(-180, 180)],
                                   degrees=True).as_matrix()
        place = np.array([*rng.uniform(-0.03, 0.03, 2), 0.45]) - turn @ board.points.mean(axis=0)
        picture = picture_of_board(board, pose_of(turn, place), pinhole)
        noisy = np.clip(picture + rng.normal(0, 3, picture.shape), 0, 255).astype(np.uint8)
        off = board.seen(noisy) - pinhole.project(board.points @ turn.T + place)
        assert np.sqrt(np.square(off).mean()) < 0.08
        assert np.abs(off.mean(axis=0)).max() < 0.02


@pytest.mark.parametrize(('tilt', 'blur'), [(65, 2.0), (70, 1.5)])
def test_small_or_blurred_squares_do_not_draw_corners_apart(tilt, blur):
    """As from 20 degrees above a table: squares are 7 to 9 px high."""
    board, pinhole = Checkerboard(10, 7, 0.02), Pinhole(640, 480, 560, 560, 320, 240)
    rng = np.random.default_rng(3)
    for _ in range(3):
        turn = Rotation.from_euler('xz', [tilt, rng.uniform(-180, 180)],
                                   degrees=True).as_matrix()
        place = np.array([0, 0, 0.5]) - turn @ board.points.mean(axis=0)
        picture = cv2.GaussianBlur(picture_of_board(board, pose_of(turn, place), pinhole),
                                   (0, 0), blur)
        noisy = np.clip(picture + rng.normal(0, 3, picture.shape), 0, 255).astype(np.uint8)
        off = board.seen(noisy) - pinhole.project(board.points @ turn.T + place)
        assert np.sqrt(np.square(off).sum(axis=1).mean()) < 0.5
