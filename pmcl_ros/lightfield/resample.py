"""From the hexagonal lattice of lenslets to square views, by the triangle of the nearest three."""

import math

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.kernels import LOCK, compiled
from pmcl_ros.lightfield.lattice import Lattice

_LEAST = 0.2  # of a pixel's three weights, the sum that must have light


def resample_views(samples: NDArray[np.float32], lattice: Lattice, origin: tuple[int, int],
                   width: int, height: int, shifts: NDArray[np.float64]) -> NDArray[np.float32]:
    """Views on the pixel grid: view pixel (x, y) lies at raw (10 x + 4.5, 10 y + 4.5).

    samples: (n, rows, columns, 3) of lenslets (j, i) = origin + (row, column).
    shifts: (n, 2) view px: view n is read at (x, y) + shifts[n], which rectifies it.
    Returns (n, height, width, 3) float32: interpolated linearly within the triangle of lenslets
    that a pixel lies in; without those of its corners that have no light (NaN or beyond `samples`)
    and 0 where the others weigh too little to tell.
    """
    cx, cy = lattice.centre_px
    with LOCK:
        return _resample(samples, lattice.pitch_px, lattice.row_step_px, lattice.rotation, cx, cy,
                         origin[0], origin[1], width, height, shifts)


@compiled(parallel=True)
def _resample(samples, pitch, row_step, rotation, cx, cy,  # type: ignore[no-untyped-def]
              j0, i0, width, height, shifts):
    views, rows, columns = samples.shape[:3]
    out = np.zeros((views, height, width, 3), np.float32)
    cos, sin = math.cos(rotation), math.sin(rotation)
    for task in prange(views * height):
        n, y = task // height, task % height
        for x in range(width):
            raw_x = 10 * (x + shifts[n, 0]) + 4.5 - cx
            raw_y = 10 * (y + shifts[n, 1]) + 4.5 - cy
            across = (-sin * raw_x + cos * raw_y) / row_step
            along = (cos * raw_x + sin * raw_y) / pitch
            j = math.floor(across)
            t = across - j  # 0 on the row above, 1 on the row below
            even = j % 2 == 0
            # Odd rows are moved by half a pitch. In coordinates skewed by that half step the
            # lenslets form unit squares (p, t), and the diagonal p + t = 1 cuts each into the two
            # triangles of the hexagonal lattice.
            skewed = (along if even else along - 0.5) - 0.5 * t
            ia = math.floor(skewed)
            p = skewed - ia
            if p + t <= 1:
                w0, w1, w2 = 1 - p - t, p, t
                c0j, c0i, c1j, c1i = j, ia, j, ia + 1
                c2j, c2i = j + 1, (ia if even else ia + 1)
            else:
                w0, w1, w2 = 1 - t, 1 - p, p + t - 1
                c0j, c0i = j, ia + 1
                first = ia if even else ia + 1
                c1j, c1i, c2j, c2i = j + 1, first, j + 1, first + 1
            total = 0.0
            red = green = blue = 0.0
            for k in range(3):
                if k == 0:
                    w, jj, ii = w0, c0j - j0, c0i - i0
                elif k == 1:
                    w, jj, ii = w1, c1j - j0, c1i - i0
                else:
                    w, jj, ii = w2, c2j - j0, c2i - i0
                if jj < 0 or jj >= rows or ii < 0 or ii >= columns:
                    continue
                r, g, b = samples[n, jj, ii, 0], samples[n, jj, ii, 1], samples[n, jj, ii, 2]
                if math.isnan(r + g + b):
                    continue
                total += w
                red += w * r
                green += w * g
                blue += w * b
            if total > _LEAST:
                out[n, y, x, 0] = red / total
                out[n, y, x, 1] = green / total
                out[n, y, x, 2] = blue / total
    return out
