"""Finding checkerboards in views, and which corner is the first."""

import functools

import numpy as np
import pytest
from board_scene import POSES, frame_of
from board_scene import plain as scene
from scipy.spatial.transform import Rotation

from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.lytro.board_search import find_board, oriented
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.calibration.lytro.corners import CornerMeter, Corners
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.runtime.errors import LightFieldError


@functools.cache
def decoder():
    return Decoder(Calibration.aligned(scene().calibration.lattice, 80, 80), scene().white())


def test_a_board_is_found_near_its_corners_and_its_depth():
    light_field = decoder().decode(frame_of(0))
    positions, disparities = find_board(Checkerboard(*scene().board), light_field)
    truth, apart = scene().corners(POSES[0])
    if np.abs(positions[0, 0] - truth[0, 0]).max() > 4:  # turned by 180 degrees: not its to tell
        positions, disparities = positions[::-1, ::-1], disparities[::-1, ::-1]
    assert np.abs(positions - truth).max() < 0.7
    assert np.abs(disparities - apart).max() < 0.15


def test_a_board_that_drowns_in_noise_is_found_in_all_views_together():
    noisy = scene().reflectance(POSES[0]) * scene().light
    rng = np.random.default_rng(2)
    noisy = noisy + 0.25 * rng.standard_normal(noisy.shape) * (scene().light > 0.1)
    light_field = decoder().decode(scene().frame(np.clip(noisy, 0, 1)))
    board = Checkerboard(*scene().board)
    positions, _ = find_board(board, light_field)
    truth, _ = scene().corners(POSES[0])
    assert min(np.abs(positions - truth).max(),
               np.abs(positions[::-1, ::-1] - truth).max()) < 1.5


@pytest.mark.parametrize('move', [(0.06, 0, 0), (0, -0.07, 0)])
def test_a_board_partly_outside_is_not_complete(move):
    pose = POSES[0].copy()
    pose[:3, 3] += move
    light_field = decoder().decode(scene().picture(pose))
    with pytest.raises(LightFieldError, match='no complete board of 6x5'):
        find_board(Checkerboard(*scene().board), light_field)


def test_another_board_is_not_this_one():
    light_field = decoder().decode(frame_of(0))
    with pytest.raises(LightFieldError, match='no complete board of 10x7'):
        find_board(Checkerboard(10, 7, 0.012), light_field)


def corners(columns, rows, first_light=True):
    """Corners whose positions are the board's own coordinates."""
    x, y = np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float))
    positions = np.stack([x, y], -1)
    contrasts = 0.3 * (-1.0) ** (x + y) * (1 if first_light else -1)
    return Corners(positions, 0 * positions, np.tile(np.eye(4), (rows, columns, 1, 1)), contrasts)


@pytest.mark.parametrize(('columns', 'rows'), [(6, 5), (5, 6), (10, 7)])
def test_the_first_corner_is_at_a_light_corner_square(columns, rows):
    board = Checkerboard(columns, rows, 0.01)
    kept = oriented(board, corners(columns, rows))
    assert (kept.positions[0, 0] == [0, 0]).all()
    turned = oriented(board, corners(columns, rows, first_light=False))
    assert (turned.positions[0, 0] == [columns - 1, rows - 1]).all()
    assert turned.contrasts[0, 0] > 0
    assert turned.contrasts[-1, -1] < 0


@pytest.mark.parametrize('first_light', [True, False])
def test_a_symmetric_board_keeps_its_x_axis_to_the_right(first_light):
    given = corners(5, 5, first_light)
    kept = oriented(Checkerboard(5, 5, 0.01), given.turned())
    assert (kept.positions == given.positions).all()


def test_squares_that_do_not_alternate_are_no_checkerboard():
    given = corners(6, 5)
    contrasts = np.abs(given.contrasts)
    with pytest.raises(LightFieldError, match='alternate'):
        oriented(Checkerboard(6, 5, 0.01), Corners(
            given.positions, given.disparities, given.covariances, contrasts))


def test_a_board_turned_in_the_picture_keeps_its_own_first_corner():
    """The same board upside down: the corners follow it."""
    pose = POSES[0].copy()
    half = np.array([2.5, 2, 0]) * 0.012
    pose[:3, :3] = POSES[0][:3, :3] @ Rotation.from_euler('z', np.pi).as_matrix()
    pose[:3, 3] = POSES[0][:3, 3] + POSES[0][:3, :3] @ half - pose[:3, :3] @ half
    frame = scene().picture(pose)
    board = Checkerboard(*scene().board)
    meter = CornerMeter(scene().calibration.lattice, decoder().light)
    found = oriented(board, meter.measure(frame, *find_board(board, decoder().decode(frame))))
    truth, _ = scene().corners(pose)
    assert np.abs(found.positions - truth).max() < 0.1
