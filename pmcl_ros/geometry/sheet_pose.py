"""Poses of a sheet by corners of it in one picture: a plane may fit tilted either way."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import least_turn, pose_of
from pmcl_ros.runtime.errors import LightFieldError

LEAST_NOISE = 0.01  # px, of a corner on each axis: no detector is better
_EVIDENT = 30.0  # least difference of two poses' squared residuals, in variances of a corner
_SAME = np.deg2rad(1)
_WIDEST = 1e3  # tangent of a corner's angle off the optical axis: a lens's are far less
_Vectors = tuple[NDArray[np.float64], NDArray[np.float64]]  # rotation (3,), origin (3,) [m]


def sheet_pose(points: NDArray[np.float64], corners: NDArray[np.float64],
               matrix: NDArray[np.float64], distortion: NDArray[np.float64]) -> _Vectors:
    """Rotation vector (3,) and origin (3,) [m] of a sheet before the camera: least squares.

    points: (n, 3) on the sheet, of which z is small, as of paper that is bent [m]. corners: (n, 2)
    where they are seen [px]. matrix, distortion: of the camera, as OpenCV's.
    Raises LightFieldError where no pose fits, as of corners on a line.
    """
    found = _fits(points, corners, matrix, distortion)
    if not found:
        raise LightFieldError('the corners are those of no board: are the numbers of the board '
                              'right?')
    return found[0][1]


def sheet_poses(points: NDArray[np.float64], corners: NDArray[np.float64], pinhole: Pinhole
                ) -> tuple[list[NDArray[np.float64]], list[float]]:
    """The poses of the board, to the camera (4, 4), that fit about as well; the best first.

    With them, the sums of squares of what is left [px^2]. Two, where it fits nearly as well tilted
    the other way; none for corners on one line. points: (n, 3) on the board, of which z is
    small [m]. corners: (n, 2) without distortion [px].
    """
    found = [(square, pose_of(Rotation.from_rotvec(turn), place)) for square, (turn, place)
             in _fits(points, corners, pinhole.matrix, np.zeros(4))]
    if not found:
        return [], []
    least, best = found[0]
    variance = max(least / max(corners.size - 6, 1), LEAST_NOISE ** 2)
    kept = [found[0], *((square, pose) for square, pose in found[1:]
                        if square - least < _EVIDENT * variance
                        and np.linalg.norm(pose[:3, :3] - best[:3, :3]) > _SAME)]
    return [pose for _, pose in kept], [square for square, _ in kept]


def _fits(points: NDArray[np.float64], corners: NDArray[np.float64], matrix: NDArray[np.float64],
          distortion: NDArray[np.float64]) -> list[tuple[float, _Vectors]]:
    """The nearest least squares of either tilt, with their sums [px^2]; the least first."""
    found = []
    for turn, place in tilts(points, corners, matrix, distortion):
        refined = cv2.solvePnPRefineLM(points, corners, matrix, distortion, turn[:, None],
                                        place[:, None])  # of vectors (3,) it returns the start
        expected, _ = cv2.projectPoints(points, *refined, matrix, distortion)
        square = float(np.square(expected[:, 0] - corners).sum())
        if np.isfinite(square):
            found.append((square, (refined[0].ravel().astype(float),
                                   refined[1].ravel().astype(float))))
    return sorted(found, key=lambda each: each[0])


def tilts(points: NDArray[np.float64], corners: NDArray[np.float64], matrix: NDArray[np.float64],
          distortion: NDArray[np.float64]) -> Iterator[_Vectors]:
    """Rotation vector and origin of a sheet either way tilted; none where corners tell no plane.

    As of `sheet_pose`. They are those of a small piece in the middle, by the derivatives of the
    homography (Collins and Bartoli, "Infinitesimal Plane-based Pose Estimation", 2014). OpenCV's
    are NaN, or far off, of a sheet that is straight before the camera.
    """
    middle = points[:, :2].mean(axis=0)
    flat = points[:, :2] - middle
    if not _tell_a_homography(flat):
        return
    seen = cv2.undistortPoints(np.ascontiguousarray(corners)[:, None], matrix, distortion)[:, 0]
    if not np.abs(seen).max() < _WIDEST:  # or NaN, by absurd coefficients
        return
    onto, _ = cv2.findHomography(flat, seen)
    if onto is None:
        return
    sight = onto[:2, 2]
    slopes = onto[:2, :2] - np.outer(sight, onto[2, :2])
    facing = least_turn(np.array([0.0, 0, 1]), np.append(sight, 1)).as_matrix()
    left, sizes, right = np.linalg.svd(np.linalg.solve(
        facing[:2, :2] - np.outer(sight, facing[2, :2]), slopes))
    shortened = sizes[1] / sizes[0]
    for rise in (np.sqrt(1 - shortened ** 2), -np.sqrt(1 - shortened ** 2)):
        along = np.concatenate([left * [1, shortened] @ right, rise * right[1:]])
        turn = facing @ np.column_stack([along, np.cross(*along.T)])
        place = np.append(sight, 1) / sizes[0] - turn[:, :2] @ middle
        yield Rotation.from_matrix(turn).as_rotvec(), place


def _tell_a_homography(flat: NDArray[np.float64]) -> bool:
    """Whether of points (n, 2) about the origin four are so that no three of them are on a line.

    Then the equations of the homography that leaves them where they are have rank 8.
    """
    x, y = flat.T / max(float(np.abs(flat).max()), 1e-12)
    one, none = np.ones_like(x), np.zeros_like(x)
    by_x = np.stack([x, y, one, none, none, none, -x * x, -x * y, -x])
    by_y = np.stack([none, none, none, x, y, one, -x * y, -y * y, -y])
    return bool(np.linalg.matrix_rank(np.concatenate([by_x, by_y], axis=1)) == 8)
