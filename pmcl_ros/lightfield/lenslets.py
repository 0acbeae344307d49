"""Read colours under each lenslet: demosaicing that never looks beyond a lenslet's own disc."""

import math

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.kernels import LOCK, compiled

_REACH = 2  # raw px: the nearest pixels of every colour of the mosaic lie closer than this
_EDGE = 0.5  # raw px: a pixel belongs to the disc that its centre is no farther outside of


def sample_lenslets(mosaic: NDArray[np.float32], centres: NDArray[np.float64],
                    offsets: NDArray[np.float64], radius: float) -> NDArray[np.float32]:
    """RGB at every offset under every lenslet.

    mosaic: (height, width) BGGR, linear.
    centres: (rows, columns, 2) raw px (column, row) of the lenslets.
    offsets: (n, 2) raw px from a centre.
    radius: of a lenslet's disc, raw px.
    Returns (n, rows, columns, 3) float32; NaN where the sensor has no pixel of a colour in reach.

    Each colour is the mean of its own pixels within 2 px, weighted by a tent of the distance, over
    the pixels of the same disc alone: another lenslet's pixels see another part of the scene. The
    pixels that the disc's edge cuts count as its own: without them the mean of an outer sample
    would lie too far inside.
    """
    with LOCK:
        return _sample(mosaic, centres, offsets, radius)


@compiled(parallel=True)
def _sample(mosaic, centres, offsets, radius):  # type: ignore[no-untyped-def]
    height, width = mosaic.shape
    rows, columns = centres.shape[:2]
    out = np.empty((offsets.shape[0], rows, columns, 3), np.float32)
    limit = (radius + _EDGE) ** 2
    for j in prange(rows):
        for i in range(columns):
            cx, cy = centres[j, i, 0], centres[j, i, 1]
            for n in range(offsets.shape[0]):
                x, y = cx + offsets[n, 0], cy + offsets[n, 1]
                x0, y0 = math.ceil(x - _REACH), math.ceil(y - _REACH)
                red = green = blue = np.float32(0)
                wr = wg = wb = np.float32(0)
                for v in range(y0, y0 + 2 * _REACH):
                    if v < 0 or v >= height:
                        continue
                    wy = np.float32(_REACH - abs(v - y))
                    for u in range(x0, x0 + 2 * _REACH):
                        if u < 0 or u >= width:
                            continue
                        if (u - cx) ** 2 + (v - cy) ** 2 > limit:
                            continue
                        w = wy * np.float32(_REACH - abs(u - x))
                        if v % 2 == 1 and u % 2 == 1:
                            red += w * mosaic[v, u]
                            wr += w
                        elif v % 2 == 0 and u % 2 == 0:
                            blue += w * mosaic[v, u]
                            wb += w
                        else:
                            green += w * mosaic[v, u]
                            wg += w
                whole = wr > 0 and wg > 0 and wb > 0
                out[n, j, i, 0] = red / wr if whole else np.nan
                out[n, j, i, 1] = green / wg if whole else np.nan
                out[n, j, i, 2] = blue / wb if whole else np.nan
    return out
