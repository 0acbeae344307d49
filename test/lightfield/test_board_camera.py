"""A camera's pose by a board, of large pictures too."""

import numpy as np
import pytest
from painted_boards import picture_of_board
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.board_camera import camera_by_board
from pmcl_ros.lightfield.calibration.boards import Checkerboard
from pmcl_ros.lightfield.sweep.frame import Lens


def test_a_large_picture_is_shrunk_with_its_lens():
    """So that it tells exactly what the picture that it becomes tells."""
    board, pinhole = Checkerboard(10, 7, 0.02), Pinhole(900, 700, 800, 800, 452, 347)
    turn = Rotation.from_euler('xz', [35, 20], degrees=True)
    seen = pose_of(turn, [0, 0, 0.5] - turn.apply(board.points.mean(axis=0)))
    small = picture_of_board(board, seen, pinhole)
    large = np.kron(small, np.ones((2, 2), np.uint8))  # 2.5 megapixels
    distortion = (-0.02, 0.01, 0.0, 0.0)
    found, same = (camera_by_board(board, picture, Lens(of, distortion), 'a') for picture, of in (
        (large, pinhole.resized(1800, 1400)), (small, pinhole)))
    np.testing.assert_allclose(found.camera, same.camera, atol=1e-6)
    assert found.pixels == pytest.approx(same.pixels, rel=1e-3)
