"""Shapes of a sheet of paper that is bent: against sheets that are rolled exactly."""

import cv2
import numpy as np
import pytest
from rolled_sheets import rolled
from scipy.spatial.transform import Rotation

from pmcl_ros.lightfield.calibration.bend import Sheet
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard

BOARDS = [Checkerboard(10, 7, 0.011), Checkerboard(3, 4, 0.05)]
if hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector'):  # from OpenCV 4.7 on
    BOARDS.append(CharucoRing(8, 11, 0.024))


def apart(points, others):
    """Largest distance [m] between points and others, moved as a whole onto them."""
    points, others = points - points.mean(axis=0), others - others.mean(axis=0)
    turn, _ = Rotation.align_vectors(points, others)
    return np.linalg.norm(points - turn.apply(others), axis=1).max()


@pytest.mark.parametrize('board', BOARDS)
@pytest.mark.parametrize('degrees', [0, 30, 90])
def test_paper_is_rolled_without_being_stretched(board, degrees):
    flat, reach = board.points, np.ptp(board.points, axis=0).max() / 2
    across = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    farthest = np.ptp(flat[:, :2] @ across) / 2
    exact = rolled(flat, 0.04 * farthest, degrees, 'gutter')
    sheet = Sheet(flat)
    bend = np.zeros(sheet.terms.shape[1])  # x^2, x y, y^2 and more
    bend[:3] = 0.04 / farthest * reach ** 2 * across[[0, 0, 1]] * across[[0, 1, 1]] * [1, 2, 1]
    found = sheet.points(bend)
    upright = flat + (exact - flat) * [0, 0, 1]
    assert apart(found, exact) < 0.1 * apart(upright, exact)


@pytest.mark.parametrize('board', BOARDS)
def test_derivatives_are_those_of_the_points(board):
    sheet = Sheet(board.points)
    bend = np.random.default_rng(0).normal(0, 1e-3, sheet.terms.shape[1])
    for term, derivative in enumerate(np.moveaxis(sheet.derivatives(bend), -1, 0)):
        step = 1e-6 * np.eye(len(bend))[term]
        slope = (sheet.points(bend + step) - sheet.points(bend - step)) / 2e-6
        np.testing.assert_allclose(derivative, slope, atol=1e-8)


def test_no_bend_is_flat():
    for board in BOARDS:
        sheet = Sheet(board.points)
        assert (sheet.points(np.zeros(sheet.terms.shape[1])) == board.points).all()
