"""Where a sheet is before a camera, by corners that are seen on it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import LightFieldError


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
