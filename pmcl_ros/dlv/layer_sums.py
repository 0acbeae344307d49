"""What is summed over a window to fit two layers along a ray."""

import cv2
import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.dlv.view_moments import CONSTANT, FIRST, REST, SECOND, ViewMoments
from pmcl_ros.runtime.kernels import LOCK, compiled

REACH = 3  # px: of the derivatives' weights, exact for polynomials up to the sixth degree

# Weights of the pixels from -3 to 3 for the derivatives of order 0 to 4.
_DERIVATIVES = np.array([[0, 0, 0, 1, 0, 0, 0],
                         np.array([-1, 9, -45, 0, 45, -9, 1]) / 60,
                         np.array([2, -27, 270, -490, 270, -27, 2]) / 180,
                         np.array([1, -8, 13, 0, -13, 8, -1]) / 8,
                         np.array([-1, 12, -39, 56, -39, 12, -1]) / 6], np.float32)

# The sums over a window that are kept, by what is multiplied.
LL, LD, LE, LQ, DD, DE, DQ, EE, EQ, QQ, OO, OG, GG, NN = range(14)
SUMS = 14


def window_sums(pictures: NDArray[np.float32], moments: ViewMoments, half: int, stride: int
                 ) -> NDArray[np.float32]:
    """(SUMS, rows, columns) products of the refocused pictures' parts, summed over the window."""
    height, width = (size - 2 * REACH for size in pictures.shape[2:])
    products = np.empty((SUMS, height, width), np.float32)
    second = np.linalg.cholesky(np.linalg.inv(moments.covariance[SECOND, SECOND])).T
    first = np.linalg.cholesky(np.linalg.inv(moments.covariance[FIRST, FIRST])).T
    with LOCK:
        _multiply(pictures[CONSTANT][0], pictures[FIRST], pictures[SECOND], pictures[REST],
                  first.astype(np.float32), second.astype(np.float32),
                  (second @ moments.fourth()).astype(np.float32), _DERIVATIVES, products)
    side = 2 * half + 1
    inside = np.s_[half:height - half:stride, half:width - half:stride]
    return np.stack([cv2.boxFilter(each, -1, (side, side), normalize=False)[inside]
                     for each in products])


@compiled(parallel=True)
def _multiply(constant, first, second, rest, white_first,  # type: ignore[no-untyped-def]
              white_second, fourth, derivatives, products):
    """Products of what a pixel holds, all in units of the noise.

    L, O: the second- and first-degree parts. G, D, Q: what h, h^2, h^4 make of the constant part's
    first, second, fourth derivatives. E: what half the sum of both displacements makes of the
    first-degree part's first derivatives.
    """
    _, height, width = products.shape
    for y in prange(height):
        products[:, y] = 0
        down = np.empty((5, width + 2 * REACH), np.float32)
        for channel in range(3):
            down[:] = 0
            for order in range(5):
                for k in range(2 * REACH + 1):
                    weight, row = derivatives[order, k], constant[channel, y + k]
                    for x in range(width + 2 * REACH):
                        down[order, x] += weight * row[x]
            for x in range(width):
                i = x + REACH
                dx, xx, x4 = np.float32(0), np.float32(0), np.float32(0)
                xy, xxxy, xxyy, xyyy = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
                for k in range(2 * REACH + 1):
                    d1, d2 = derivatives[1, k], derivatives[2, k]
                    dx += d1 * down[0, x + k]
                    xx += d2 * down[0, x + k]
                    x4 += derivatives[4, k] * down[0, x + k]
                    xy += d1 * down[1, x + k]
                    xxxy += derivatives[3, k] * down[1, x + k]
                    xxyy += d2 * down[2, x + k]
                    xyyy += d1 * down[3, x + k]
                dy, yy, y4 = down[1, i], down[2, i], down[4, i]
                ax, ay, bx, by = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
                for k in range(2 * REACH + 1):
                    d1 = derivatives[1, k]
                    ax += d1 * first[0, channel, y + REACH, x + k]
                    bx += d1 * first[1, channel, y + REACH, x + k]
                    ay += d1 * first[0, channel, y + k, i]
                    by += d1 * first[1, channel, y + k, i]
                half = np.float32(0.5)
                for r in range(3):
                    a, b, c = white_second[r, 0], white_second[r, 1], white_second[r, 2]
                    lr = (a * second[0, channel, y + REACH, i]
                          + b * second[1, channel, y + REACH, i]
                          + c * second[2, channel, y + REACH, i])
                    dr = half * a * xx + b * xy + half * c * yy
                    er = a * ax + b * (ay + bx) + c * by
                    qr = (fourth[r, 0] * x4 + fourth[r, 1] * xxxy + fourth[r, 2] * xxyy
                          + fourth[r, 3] * xyyy + fourth[r, 4] * y4)
                    products[LL, y, x] += lr * lr
                    products[LD, y, x] += lr * dr
                    products[LE, y, x] += lr * er
                    products[LQ, y, x] += lr * qr
                    products[DD, y, x] += dr * dr
                    products[DE, y, x] += dr * er
                    products[DQ, y, x] += dr * qr
                    products[EE, y, x] += er * er
                    products[EQ, y, x] += er * qr
                    products[QQ, y, x] += qr * qr
                for r in range(2):
                    a, b = white_first[r, 0], white_first[r, 1]
                    odd = (a * first[0, channel, y + REACH, i]
                           + b * first[1, channel, y + REACH, i])
                    slope = a * dx + b * dy
                    products[OO, y, x] += odd * odd
                    products[OG, y, x] += odd * slope
                    products[GG, y, x] += slope * slope
                    noise = rest[r, channel, y + REACH, i]
                    products[NN, y, x] += noise * noise
