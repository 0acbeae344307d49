"""Integer counts <-> linear values: the views of a light field as one picture, side by side."""

from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.runtime.kernels import LOCK, compiled

VIEW_WHITE = 32768  # count at the sensor's white: room for twice that, then clipped
VIEW_MOST = 65535


def linear_views(counts: NDArray[np.uint8] | NDArray[np.uint16], white: float
                 ) -> NDArray[np.float32]:
    """Float32 counts / white of views (rows, columns, height, width, 3)."""
    lines: NDArray[Any] = np.ascontiguousarray(counts).reshape(-1, counts.shape[3] * 3)
    return _linear(lines, np.arange(len(lines)), white).reshape(counts.shape)


def views_of_mosaic(mosaic: NDArray[np.uint16], rows: int, columns: int) -> NDArray[np.float32]:
    """(rows, columns, height, width, 3) linear views of a mosaic (rows height, columns width, 3).

    Its counts are VIEW_WHITE at 1.
    """
    height, width = mosaic.shape[0] // rows, mosaic.shape[1] // columns
    lines = np.arange(mosaic.shape[0] * columns).reshape(rows, height, columns)
    linear = _linear(np.ascontiguousarray(mosaic).reshape(-1, width * 3),
                     lines.transpose(0, 2, 1).ravel(), VIEW_WHITE)
    return linear.reshape(rows, columns, height, width, 3)


def mosaic_of_views(views: NDArray[np.float32]) -> NDArray[np.uint16]:
    """The inverse of `views_of_mosaic`, rounded, clipped to what counts can hold."""
    rows, columns, height, width = views.shape[:4]
    counts = np.clip(views * np.float32(VIEW_WHITE) + np.float32(0.5), 0, VIEW_MOST)
    tiles = counts.astype('<u2').transpose(0, 2, 1, 3, 4)
    return tiles.reshape(rows * height, columns * width, 3)


def _linear(lines: NDArray[np.uint8] | NDArray[np.uint16], order: NDArray[np.int64], white: float
            ) -> NDArray[np.float32]:
    """(n, m) lines in another order, over white."""
    linear = np.empty(lines.shape, np.float32)
    with LOCK:
        _scale(lines, order, np.float32(1 / white), linear)
    return linear


@compiled(parallel=True)
def _scale(lines, order, factor, out):  # type: ignore[no-untyped-def]
    for number in prange(len(order)):
        source, scaled = lines[order[number]], out[number]
        for k in range(len(source)):
            scaled[k] = np.float32(source[k]) * factor
