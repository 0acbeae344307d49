"""What is compared: gamma-encoded colours and luminance gradients, a padded plane for each."""

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.kernels import LOCK, compiled
from pmcl_ros.lightfield.light_field import LightField

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709
_ONE = int(np.float32(1).view(np.int32))
_STEP = 15  # bits of a float below the knots of the curve: 256 knots an octave, 5e-7 of the value


def matching_planes(light_field: LightField, indices: NDArray[np.int64],
                    pad: int) -> NDArray[np.float32]:
    """(1 + views, 5, height + 2 pad, width + 2 pad) float32, the channels of `reference.channels`.

    They are red, green, blue in [0, 1], gamma encoded, then d/dx and d/dy of the luminance [1/px];
    of the centre view first, then of those of `indices` (views, 2), row and column. The border's
    values go on outwards for `pad` px (clamp to edge).
    """
    chosen = np.vstack([[light_field.grid.centre], indices])
    height, width = light_field.views.shape[2:4]
    planes = np.empty((len(chosen), 5, height + 2 * pad, width + 2 * pad), np.float32)
    with LOCK:
        views = np.asarray(light_field.views, np.float32)
        _fill(views.view(np.int32), chosen, _curve(light_field.gamma), pad, planes)
    return planes


def _curve(gamma: float) -> NDArray[np.float32]:
    """x ** gamma where the upper bits of x count up from 0: knots evenly spaced in each octave."""
    knots = (np.arange((_ONE >> _STEP) + 2) << _STEP).astype(np.int32).view(np.float32)
    return (knots.astype(float) ** gamma).astype(np.float32)


@compiled()
def _encode(bits, curve, out):  # type: ignore[no-untyped-def]
    """One row (width, 3) of colours, as the bits of their floats, encoded into out (3, width)."""
    part = np.float32(0.5 ** _STEP)
    for channel in range(3):
        for x in range(len(bits)):
            place = min(max(bits[x, channel], 0), _ONE)  # from 0 up, floats sort as their bits
            knot = place >> _STEP
            low, high = curve[knot], curve[knot + 1]
            out[channel, x] = low + (high - low) * (np.float32(place & ((1 << _STEP) - 1)) * part)


@compiled(parallel=True)
def _fill(bits, chosen, curve, pad, planes):  # type: ignore[no-untyped-def]
    for view in prange(len(chosen)):
        _fill_view(bits[chosen[view, 0], chosen[view, 1]], curve, pad, planes[view])


@compiled()
def _fill_view(bits, curve, pad, planes):  # type: ignore[no-untyped-def]
    height, width = bits.shape[:2]
    luminance = np.empty((height, width), np.float32)
    half = np.float32(0.5)
    inside = planes[:, pad:pad + height, pad:pad + width]
    for y in range(height):
        _encode(bits[y], curve, inside[:, y])
        for x in range(width):
            luminance[y, x] = (LUMINANCE[0] * inside[0, y, x] + LUMINANCE[1] * inside[1, y, x]
                               + LUMINANCE[2] * inside[2, y, x])
    for y in range(height):
        row = luminance[y]
        above, below = luminance[max(y - 1, 0)], luminance[min(y + 1, height - 1)]
        for x in range(width):
            inside[3, y, x] = half * (row[min(x + 1, width - 1)] - row[max(x - 1, 0)])
            inside[4, y, x] = half * (below[x] - above[x])
    for plane in planes:
        _extend(plane, pad)


@compiled()
def _extend(plane, pad):  # type: ignore[no-untyped-def]
    """Carry the border's values `pad` px outwards."""
    height, width = plane.shape
    for y in range(pad, height - pad):
        row = plane[y]
        for x in range(pad):
            row[x] = row[pad]
            row[width - 1 - x] = row[width - 1 - pad]
    for y in range(pad):
        for x in range(width):
            plane[y, x] = plane[pad, x]
            plane[height - 1 - y, x] = plane[height - 1 - pad, x]
