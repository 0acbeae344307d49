"""What is compared: gamma-encoded colours and luminance gradients, a padded plane for each."""

from functools import lru_cache

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.dlv.sampling import SMOOTHER
from pmcl_ros.kernels import LOCK, compiled
from pmcl_ros.lightfield.light_field import LightField

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709
_SMOOTHER = SMOOTHER.astype(np.float32)
HALO = 3  # px around a pixel that its channels are made from: 2 of the smoothing, 1 of a gradient
_ONE = int(np.float32(1).view(np.int32))
_STEP = 14  # bits of a float below the knots of the curve: 512 knots an octave, 1e-7 of the value


def matching_planes(light_field: LightField, indices: NDArray[np.int64],
                    window: tuple[int, int, int, int], pad: int, smooth: bool = False
                    ) -> NDArray[np.float32]:
    """(1 + views, 5, height + 2 pad, width + 2 pad) float32, the channels of `reference.channels`.

    They are red, green, blue in [0, 1], gamma encoded, then d/dx and d/dy of the luminance [1/px];
    of the centre view first, then of those of `indices` (views, 2), row and column.
    window: left, top, width, height [px] of the part of the views that is read. Its border's
    values go on outwards for `pad` px (clamp to edge); where that is not the image's, the `HALO`
    pixels at it are not those of the whole. smooth: through `sampling.SMOOTHER`.
    """
    chosen = np.vstack([[light_field.grid.centre], indices])
    planes = np.empty((len(chosen), 5, window[3] + 2 * pad, window[2] + 2 * pad), np.float32)
    with LOCK:
        views = np.asarray(light_field.views, np.float32)
        _fill(views.view(np.int32), chosen, _curve(light_field.gamma), window, pad, smooth, planes)
    return planes


def colour_planes(light_field: LightField, indices: NDArray[np.int64], pad: int
                  ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """(views, 3, height + 2 pad, width + 2 pad) float32, and the mean of each view (views,).

    They are red, green, blue of the views at `indices` as in `matching_planes`, through
    `sampling.SMOOTHER`. Outside the image are its mirrored borders: an edge that runs out of the
    image goes on.
    """
    height, width = light_field.views.shape[2:4]
    planes = np.empty((len(indices), 3, height + 2 * pad, width + 2 * pad), np.float32)
    means = np.empty(len(indices))
    with LOCK:
        views = np.asarray(light_field.views, np.float32)
        _fill_colours(views.view(np.int32), indices, _curve(light_field.gamma), pad, planes, means)
    return planes, means


@lru_cache(maxsize=4)
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
def _fill(bits, chosen, curve, window, pad, smooth, planes):  # type: ignore[no-untyped-def]
    left, top, width, height = window
    for view in prange(len(chosen)):
        _fill_view(bits[chosen[view, 0], chosen[view, 1], top:top + height, left:left + width],
                   curve, pad, smooth, planes[view])


@compiled(parallel=True)
def _fill_colours(bits, chosen, curve, pad, planes, means):  # type: ignore[no-untyped-def]
    for view in prange(len(chosen)):
        source = bits[chosen[view, 0], chosen[view, 1]]
        height, width = source.shape[:2]
        inside = planes[view, :, pad:pad + height, pad:pad + width]
        total = 0.0
        for y in range(height):
            _encode(source[y], curve, inside[:, y])
            part = np.float32(0)
            for channel in range(3):
                for x in range(width):
                    part += inside[channel, y, x]
            total += part
        for channel in range(3):
            _smooth(inside[channel])
        means[view] = total / (3 * height * width)
        for plane in planes[view]:
            _mirror(plane, pad)


@compiled()
def mirrored(place, count):  # type: ignore[no-untyped-def]
    """The index within 0..count-1 that a place outside mirrors; the end where that is outside."""
    return min(max(min(abs(place), 2 * (count - 1) - place), 0), count - 1)


@compiled()
def _mirror(plane, pad):  # type: ignore[no-untyped-def]
    """Mirror the picture within, at its border's pixels, into the `pad` px around."""
    height, width = plane.shape[0] - 2 * pad, plane.shape[1] - 2 * pad
    for y in range(pad, height + pad):
        row = plane[y]
        for x in range(pad):
            row[x] = row[pad + mirrored(x - pad, width)]
            row[width + pad + x] = row[pad + mirrored(width + x, width)]
    for y in range(pad):
        plane[y] = plane[pad + mirrored(y - pad, height)]
        plane[height + pad + y] = plane[pad + mirrored(height + y, height)]


@compiled()
def _fill_view(bits, curve, pad, smooth, planes):  # type: ignore[no-untyped-def]
    height, width = bits.shape[:2]
    luminance = np.empty((height, width), np.float32)
    half = np.float32(0.5)
    inside = planes[:, pad:pad + height, pad:pad + width]
    for y in range(height):
        _encode(bits[y], curve, inside[:, y])
    if smooth:
        for channel in range(3):
            _smooth(inside[channel])
    for y in range(height):
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
def _smooth(plane):  # type: ignore[no-untyped-def]
    """Through `sampling.SMOOTHER` along both axes, the border going on, in place."""
    height, width = plane.shape
    outer, inner, middle = _SMOOTHER[0], _SMOOTHER[1], _SMOOTHER[2]
    row = np.empty(width + 4, np.float32)
    rows = np.empty((height + 4, width), np.float32)
    for y in range(height):
        row[2:width + 2] = plane[y]
        row[:2] = plane[y, 0]
        row[width + 2:] = plane[y, width - 1]
        out = rows[y + 2]
        for x in range(width):
            out[x] = (outer * (row[x] + row[x + 4]) + inner * (row[x + 1] + row[x + 3])
                      + middle * row[x + 2])
    rows[0] = rows[1] = rows[2]
    rows[height + 2] = rows[height + 3] = rows[height + 1]
    for y in range(height):
        for x in range(width):
            plane[y, x] = (outer * (rows[y, x] + rows[y + 4, x])
                           + inner * (rows[y + 1, x] + rows[y + 3, x]) + middle * rows[y + 2, x])


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
