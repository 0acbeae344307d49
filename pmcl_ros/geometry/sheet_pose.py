"""Poses of a sheet by corners of it in one picture: a plane may fit tilted either way."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.runtime.errors import LightFieldError

_LEAST_NOISE = 0.01  # px, on each axis: no detector is better
_EVIDENT = 30.0  # least difference of two poses' squared residuals, in variances of a corner
_SAME = np.deg2rad(1)


def sheet_pose(points: NDArray[np.float64], corners: NDArray[np.float64],
               matrix: NDArray[np.float64], distortion: NDArray[np.float64]
               ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation vector (3,) and origin (3,) [m] of a sheet before the camera: least squares.

    points: (n, 3) on the sheet, of which z is small, as of paper that is bent [m]. corners: (n, 2)
    where they are seen [px]. matrix, distortion: of the camera, as OpenCV's.
    (Collins and Bartoli, "Infinitesimal Plane-based Pose Estimation", 2014, then refined.)
    Raises LightFieldError where no pose fits, as of corners on a line.
    """
    flat = points * [1, 1, 0]
    is_found, turn, place = cv2.solvePnP(flat, corners, matrix, distortion,
                                         flags=cv2.SOLVEPNP_IPPE)
    if not is_found:
        raise LightFieldError('the corners are those of no board: are the numbers of the board '
                              'right?')
    turn, place = cv2.solvePnPRefineLM(points, corners, matrix, distortion, turn, place)
    return np.asarray(turn, float).ravel(), np.asarray(place, float).ravel()


def sheet_poses(points: NDArray[np.float64], corners: NDArray[np.float64], pinhole: Pinhole
                ) -> tuple[list[NDArray[np.float64]], list[float]]:
    """The poses of the board, to the camera (4, 4), that fit about as well; the best first.

    With them, the sums of squares of what is left [px^2]. Two, where it fits nearly as well tilted
    the other way; none for corners on one line. points: (n, 3) on the board, of which z is
    small [m]. corners: (n, 2) without distortion [px].
    """
    _, turns, places, _ = cv2.solvePnPGeneric(points * [1, 1, 0], corners, pinhole.matrix,
                                              np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
    found = []
    for each in zip(turns, places, strict=True):
        if not np.isfinite(each).all():
            continue
        turn, place = cv2.solvePnPRefineLM(points, corners, pinhole.matrix, np.zeros(4), *each)
        pose = pose_of(Rotation.from_rotvec(turn.ravel()), place.ravel().astype(float))
        off = pinhole.project(points @ pose[:3, :3].T + pose[:3, 3]) - corners
        found.append((float(np.square(off).sum()), pose))
    if not found:
        return [], []
    found.sort(key=lambda each: each[0])
    least, best = found[0]
    variance = max(least / max(corners.size - 6, 1), _LEAST_NOISE ** 2)
    kept = [found[0], *((square, pose) for square, pose in found[1:]
                        if square - least < _EVIDENT * variance
                        and np.linalg.norm(pose[:3, :3] - best[:3, :3]) > _SAME)]
    return [pose for _, pose in kept], [square for square, _ in kept]
