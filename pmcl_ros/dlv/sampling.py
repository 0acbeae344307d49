"""How a picture is read between its pixels, separably, from four pixels along each axis.

Bilinear weights average noise: half-way between pixels a quarter of its power is left in two
dimensions, at a pixel all of it. A cost of flat pixels so has its minimum wherever a label
displaces views by half a pixel. `neutral_taps` leave the same power everywhere
(docs/concepts/volume.md).
"""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.kernels import compiled

TAPS = 4  # pixels along an axis that a sample is made from

# Response 1 - sin^4(pi f): level up to the frequencies that lenslets resolve, zero at Nyquist,
# where no four pixels can tell a displacement (Shapiro 1970).
SMOOTHER = np.array([-1, 4, 10, 4, -1]) / 16

# Autocovariance of white noise so smoothed, 0 to 3 px apart.
_NOISE = np.correlate(SMOOTHER, SMOOTHER, 'full')[4:8]
_COVARIANCE = _NOISE[np.abs(np.subtract.outer(range(4), range(4)))]


def bilinear_taps(fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 4) weights of the pixels at -1, 0, 1, 2 for a place `fraction` (...) px from pixel 0.
    """
    zero = np.zeros_like(fraction)
    return np.stack([zero, 1 - fraction, fraction, zero], axis=-1)


def neutral_taps(fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights like `bilinear_taps`, for a picture that was smoothed by `SMOOTHER`.

    They are those of cubic interpolation with a second difference large enough that white noise,
    smoothed alike, keeps its power at every fraction exactly. Constants and ramps are kept.
    """
    u = fraction[..., None]
    odd = u * (u - 1) * (2 * u - 1) / 12 * [-1, 3, -3, 1]  # as of Lagrange's cubic
    base = bilinear_taps(fraction) + odd
    even = np.array([-1, 1, 1, -1.0])
    # power(base + c even) = power of a pixel
    bend = even @ _COVARIANCE @ even
    half = base @ _COVARIANCE @ even
    excess = np.einsum('...i,ij,...j->...', base, _COVARIANCE, base) - _COVARIANCE[0, 0]
    c = (np.sqrt(np.maximum(half ** 2 - bend * excess, 0)) - half) / bend
    return np.asarray(base + c[..., None] * even)


def smoothed(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """`image` (..., height, width) through `SMOOTHER` along both axes, its border going on."""
    for axis in (-2, -1):
        width = [(2, 2) if k % image.ndim == axis % image.ndim else (0, 0)
                 for k in range(image.ndim)]
        padded = np.pad(image, width, mode='edge')
        count = image.shape[axis]
        image = sum(weight * np.take(padded, range(k, k + count), axis)
                    for k, weight in enumerate(SMOOTHER))
    return image


@compiled(inner=True)
def copy_row(row, out):  # type: ignore[no-untyped-def]
    """`out[:] = row`: to compile that, with its message of wrong shapes, takes seconds."""
    for x in range(len(out)):
        out[x] = row[x]


@compiled(inner=True)
def sample_row(view, x, y, taps, stride, between, out, count):  # type: ignore[no-untyped-def]
    """`count` samples of a row, `stride` apart, from the pixels around (x, y) on: down, across."""
    source = stride * (count - 1) + TAPS
    above, upper = view[y - 1, x - 1:x - 1 + source], view[y, x - 1:x - 1 + source]
    lower, below = view[y + 1, x - 1:x - 1 + source], view[y + 2, x - 1:x - 1 + source]
    # Weights of differences: what is the same everywhere is then read exactly.
    a, c, d = taps[1, 0], taps[1, 2], taps[1, 3]
    for i in range(source):
        u = upper[i]
        between[i] = u + (a * (above[i] - u) + c * (lower[i] - u) + d * (below[i] - u))
    a, c, d = taps[0, 0], taps[0, 2], taps[0, 3]
    if stride == 1:
        for i in range(count):
            u = between[i + 1]
            out[i] = u + (a * (between[i] - u) + c * (between[i + 2] - u)
                          + d * (between[i + 3] - u))
    else:
        for i in range(count):
            k = stride * i
            u = between[k + 1]
            out[i] = u + (a * (between[k] - u) + c * (between[k + 2] - u)
                          + d * (between[k + 3] - u))
