"""Corners of the squares of a board, to a hundredth of a pixel."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

_UNTIL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)  # steps, px
_DRAWN = 0.1  # px: that corners may be drawn out of line where they are refined


def refined(picture: NDArray[np.uint8], corners: NDArray[np.float64], plane: NDArray[np.float64],
            free: float) -> NDArray[np.float64]:
    """(m, 2) px: the corners in a grey picture, where the edges of their squares cross.

    corners: (m, 2) as a detector has them [px]; OpenCV's are off together, by up to a tenth of a
    pixel. plane: (m, 2) where they are on the board, in squares. free: of a square, to each side
    of a corner, where no other edge is. Of small or blurred squares other edges draw the corners
    apart: these stay as they are.
    """
    onto, _ = cv2.findHomography(plane, corners)
    if onto is None:
        return corners
    here, *beside = (cv2.perspectiveTransform((plane + step)[:, None], onto)[:, 0]
                     for step in ((0, 0), (1, 0), (0, 1)))
    side = min(np.linalg.norm(each - here, axis=1).min() for each in beside)
    reach = max(1, int(free * side))
    crossing = np.asarray(cv2.cornerSubPix(picture, corners.astype(np.float32).reshape(-1, 1, 2),
                                           (reach, reach), (-1, -1), _UNTIL), float)[:, 0]
    is_better = _out_of_line(crossing, plane) - _out_of_line(corners, plane) < _DRAWN ** 2
    return crossing if is_better else corners


def _out_of_line(corners: NDArray[np.float64], plane: NDArray[np.float64]) -> float:
    """Mean square distance of the corners from where a plane's would be [px^2]."""
    onto, _ = cv2.findHomography(plane, corners)
    if onto is None:
        return math.inf
    off = cv2.perspectiveTransform(plane[:, None], onto)[:, 0] - corners
    return float(np.square(off).sum(axis=1).mean())
