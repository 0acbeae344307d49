"""A picture shifted by a part of a pixel."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

_HALF = 3  # pixels each side: a polynomial of the fifth degree through six


def shifted(picture: NDArray[np.float32], x: float, y: float) -> NDArray[np.float32]:
    """`picture` (height, width, 3) read at every pixel plus (x, y) [px].

    Outside, the border's values go on (as in matching); what rings below 0 becomes 0. Whole pixels
    are exact. The place is exact too, unlike with cv2.remap, which knows 32 places in a pixel.
    """
    if x == y == 0:
        return picture
    height, width = picture.shape[:2]
    columns, across = _taps(x, width)
    rows, down = _taps(y, height)
    around = np.ascontiguousarray(picture[rows][:, columns])
    anchor = (_HALF - 1, _HALF - 1)
    filtered = cv2.sepFilter2D(around, cv2.CV_32F, across, down, anchor=anchor)
    inside = filtered[_HALF - 1:_HALF - 1 + height, _HALF - 1:_HALF - 1 + width]
    return np.maximum(inside, np.float32(0))


def _taps(shift: float, size: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The pixels that are read for a row of `size`, and the weights of each one's neighbours."""
    whole = math.floor(shift)
    places = np.arange(1 - _HALF, size + _HALF) + whole
    nodes = np.arange(1 - _HALF, _HALF + 1)
    gaps = nodes[:, None] - nodes + np.eye(len(nodes))  # 1 where a node meets itself
    parts = np.where(np.eye(len(nodes), dtype=bool), 1, (shift - whole - nodes) / gaps)
    return np.clip(places, 0, size - 1), parts.prod(axis=1)  # Lagrange's form
