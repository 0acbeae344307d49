"""A camera's pose by a board: of large pictures, of one seen through glass."""

import re

import cv2
import numpy as np
import pytest
from painted_boards import picture_of_board
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, local, pose_of
from pmcl_ros.lightfield.board_camera import camera_by_board
from pmcl_ros.lightfield.calibration.boards import Checkerboard
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.sweep.frame import Lens

BOARD = Checkerboard(10, 7, 0.02)
_TURN = Rotation.from_euler('xz', [35, 20], degrees=True)
SEEN = pose_of(_TURN, [0, 0, 0.5] - _TURN.apply(BOARD.points.mean(axis=0)))  # to the camera


def test_a_large_picture_is_shrunk_with_its_lens():
    """So that it tells exactly what the picture that it becomes tells."""
    pinhole = Pinhole(900, 700, 800, 800, 452, 347)
    small = picture_of_board(BOARD, SEEN, pinhole)
    large = np.kron(small, np.ones((2, 2), np.uint8))  # 2.5 megapixels
    distortion = (-0.02, 0.01, 0.0, 0.0)
    found, same = (camera_by_board(BOARD, picture, Lens(of, distortion), 'a') for picture, of in (
        (large, pinhole.resized(1800, 1400)), (small, pinhole)))
    np.testing.assert_allclose(found.at.camera, same.at.camera, atol=1e-6)
    assert found.at.pixels == pytest.approx(same.at.pixels, rel=1e-3)


@pytest.mark.parametrize(('fx', 'longer'), [(800, 0), (808, 0), (760, 800 / 760 - 1),
                                            (850, 800 / 850 - 1)])
def test_a_focal_length_that_is_clearly_another_is_told(fx, longer):
    pinhole = Pinhole(900, 700, 800, 800, 452, 347)
    found = camera_by_board(BOARD, picture_of_board(BOARD, SEEN, pinhole),
                            Lens(Pinhole(900, 700, fx, fx, 452, 347)), 'a')
    if not longer:
        assert found.lens is None
        return
    told = re.fullmatch(r'a focal length that is (\d+) % (longer|shorter) \(.*\)', found.lens)
    assert told, found.lens
    assert int(told[1]) == pytest.approx(100 * abs(longer), abs=1)
    assert told[2] == ('longer' if longer > 0 else 'shorter')


@pytest.mark.skipif(not hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector'),
                    reason='OpenCV before 4.7')
def test_corners_that_glass_shifts_do_not_move_the_camera():
    ring, lens = CharucoRing(8, 11, 0.024), Lens(Pinhole(640, 480, 600, 600, 322, 238))
    pose = pose_of(Rotation.from_euler('xz', [140, 25], degrees=True), [0, 0, 0.45])
    picture = picture_of_board(ring, pose, lens.pinhole)
    exact = lens.pinhole.project(ring.points @ pose[:3, :3].T + pose[:3, 3])
    x, y = np.rint(exact[0]).astype(int)
    glass = slice(y - 45, y + 45), slice(x - 45, x + 45)
    shifted = picture.copy()
    shifted[glass] = np.roll(picture, 5, axis=1)[glass]
    behind = (np.abs(exact - exact[0]) < 40).all(axis=1)
    assert np.isfinite(ring.seen(shifted)[behind]).any()  # and 5 px from where they are
    found = camera_by_board(ring, shifted, lens, 'the image')
    away = local(found.at.camera[None], inverse(pose))[0]
    assert np.linalg.norm(away[:3]) < 0.0005
    assert np.linalg.norm(away[3:]) < 0.0015
