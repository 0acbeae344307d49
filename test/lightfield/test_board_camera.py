"""A camera's pose by a board: of large pictures, of one seen through glass."""

import re
from functools import partial

import cv2
import numpy as np
import pytest
from painted_boards import picture_of_board, picture_of_sheet
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, local, pose_of
from pmcl_ros.lightfield.board_camera import BoardCamera
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
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
    found, same = (BoardCamera(BOARD).find(picture, Lens(of, distortion), 'a') for picture, of in (
        (large, pinhole.resized(1800, 1400)), (small, pinhole)))
    np.testing.assert_allclose(found.at.camera, same.at.camera, atol=1e-6)
    assert found.at.pixels == pytest.approx(same.at.pixels, rel=1e-3)


@pytest.mark.parametrize(('fx', 'longer'), [(800, 0), (808, 0), (760, 800 / 760 - 1),
                                            (850, 800 / 850 - 1)])
def test_a_focal_length_that_is_clearly_another_is_told(fx, longer):
    pinhole = Pinhole(900, 700, 800, 800, 452, 347)
    found = BoardCamera(BOARD).find(picture_of_board(BOARD, SEEN, pinhole),
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
    found = BoardCamera(ring).find(shifted, lens, 'the image')
    away = local(found.at.camera[None], inverse(pose))[0]
    assert np.linalg.norm(away[:3]) < 0.0005
    assert np.linalg.norm(away[3:]) < 0.0015


def test_pictures_from_several_sides_tell_how_the_paper_is_bent():
    pinhole, top = Pinhole(640, 480, 600, 600, 322, 238), 3e-3
    middle = BOARD.points.mean(axis=0)

    def curled(sign):  # z points into the table
        return lambda places: -top * np.square((places - middle[:2]) @ [0.8, sign * 0.6] / 0.12)

    def seen(camera, azimuth, bend):
        turn = (Rotation.from_euler('x', 40, degrees=True)
                * Rotation.from_euler('z', azimuth, degrees=True))
        pose = pose_of(turn, [0, 0, 0.45] - turn.apply(middle))
        picture = picture_of_sheet(BOARD, pose, pinhole, bend)
        found = camera.find(picture, Lens(pinhole), 'the image')
        assert found.lens is None
        moved = (found.at.camera @ pose)[:3]  # what stands on the board
        above = np.append(middle - [0, 0, 0.06], 1)
        return np.linalg.norm(moved @ above - above[:3]), found.at

    camera = BoardCamera(BOARD)
    offs = [seen(camera, azimuth, curled(1))[0] for azimuth in (0, 60, 120)]
    assert max(offs[1:]) < 0.2e-3
    _, alone = seen(BoardCamera(BOARD), 160, curled(1))
    _, together = seen(camera, 160, curled(1))
    assert together.sigma_beside(BOARD.points)[0] < alone.sigma_beside(BOARD.points)[0]
    # Another sheet in its place: after some pictures the sides before count no more.
    offs = [seen(camera, azimuth, curled(-1))[0] for azimuth in (20, 80, 140, 200)]
    assert max(offs[3:]) < 0.2e-3


def test_a_sheet_that_is_bent_far_otherwise_is_seen_at_once():
    def bend(places, across):
        return -0.015 * np.square((places - middle[:2]) @ across / 0.12)

    def unrolled(places, across):
        """Lengths along a parabola."""
        steep, along = 2 * 0.015 / 0.12 ** 2, (places - middle[:2]) @ across
        length = (along * np.sqrt(1 + (steep * along) ** 2) + np.arcsinh(steep * along) / steep)
        return places + np.outer(length / 2 - along, across)

    pinhole, middle = Pinhole(640, 480, 600, 600, 322, 238), BOARD.points.mean(axis=0)
    camera = BoardCamera(BOARD)
    for azimuth, side in [(20, 0.6), (80, 0.6), (140, 0.6), (200, 0.6), (47, -0.6)]:
        turn = (Rotation.from_euler('x', 40, degrees=True)
                * Rotation.from_euler('z', azimuth, degrees=True))
        pose = pose_of(turn, [0, 0, 0.5] - turn.apply(middle))
        across = np.array([0.8, side])
        picture = picture_of_sheet(BOARD, pose, pinhole, partial(bend, across=across),
                                   partial(unrolled, across=across))
        found = camera.find(picture, Lens(pinhole), 'the image')
        moved = (found.at.camera @ pose)[:3]
        above = np.append(middle - [0, 0, 0.06], 1)
        assert np.linalg.norm(moved @ above - above[:3]) < 0.5e-3
