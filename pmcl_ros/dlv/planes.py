"""Planes to match: gamma-encoded colours and luminance gradients, with a border around."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.sampling import SMOOTHER, TAPS, copy_row
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.kernels import compiled, rounds

# Exponent that encodes linear light, whatever a camera's own is for looking: the noise of dark and
# of bright pixels counts about alike.
ENCODING = 1 / 2.4
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709
_SMOOTHER = SMOOTHER[:3].astype(np.float32)  # it is symmetric
_NONE = np.array([0, 0, 1], np.float32)  # in place of it: it leaves a view as it is
HALO = 3  # px around a pixel that its channels are made from: 2 of the smoothing, 1 of a gradient
_ONE = int(np.float32(1).view(np.int32))  # the bits of 1.0
_STEP = 14  # bits of a float below the knots of the curve: 512 knots an octave, 1e-7 of the value


def matching_planes(light_field: LightField, indices: NDArray[np.int64],
                    window: tuple[int, int, int, int], smooth: bool) -> NDArray[np.float32]:
    """(1 + views, height + 2 TAPS, 5, columns) float32, the channels of `reference.channels`.

    They are red, green, blue in [0, 1], gamma encoded, then d/dx and d/dy of the luminance [1/px];
    of the centre view first, then of those of `indices` (views, 2), row and column. The channels
    of a row of pixels follow each other, so that one loop samples all of them.
    window: left, top, width, height [px] of the part of the views that is read. Its border's
    values go on outwards for `TAPS` px (clamp to edge), to the right for more: columns fill an odd
    number of cache lines, lest neighbouring channels compete for the same places in a cache. Where
    the border is not the image's, the `HALO` pixels at it are not those of the whole. smooth:
    through `sampling.SMOOTHER`.
    """
    chosen = np.vstack([[light_field.grid.centre], indices])
    columns = 16 * (-(-(window[2] + 2 * TAPS) // 16) | 1)
    planes = np.empty((len(chosen), window[3] + 2 * TAPS, 5, columns), np.float32)
    _fill(_bits(light_field), chosen, _curve(ENCODING), window, TAPS,
          _SMOOTHER if smooth else _NONE, planes)
    return planes


def colour_planes(light_field: LightField, indices: NDArray[np.int64], pad: int,
                  gamma: float = ENCODING) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """(views, 3, height + 2 pad, width + 2 pad) float32, and the mean of each view (views,).

    They are red, green, blue of the views at `indices` as in `matching_planes`, through
    `sampling.SMOOTHER`. gamma: the exponent; 1: linear light. Outside the image are its mirrored
    borders: an edge that runs out of the image goes on.
    """
    height, width = light_field.views.shape[2:4]
    planes = np.empty((len(indices), 3, height + 2 * pad, width + 2 * pad), np.float32)
    means = np.empty(len(indices))
    _fill_colours(_bits(light_field), np.ascontiguousarray(indices), _curve(gamma), pad,
                  planes, means)
    return planes, means


def _bits(light_field: LightField) -> NDArray[np.int32]:
    """(rows, columns, height, 3 width) the views' values, as the bits of their floats."""
    views = np.ascontiguousarray(light_field.views, np.float32)
    return views.reshape(*views.shape[:3], -1).view(np.int32)


@lru_cache(maxsize=4)
def _curve(gamma: float) -> NDArray[np.float32]:
    """x ** gamma where the upper bits of x count up from 0: knots evenly spaced in each octave."""
    knots = (np.arange((_ONE >> _STEP) + 2) << _STEP).astype(np.int32).view(np.float32)
    return (knots.astype(float) ** gamma).astype(np.float32)


@compiled(inner=True)
def _encode(bits, curve, line, red, green, blue):  # type: ignore[no-untyped-def]
    """A row of `_bits` encoded into three of (width,). line: (3 width,) to work in."""
    part = np.float32(0.5 ** _STEP)
    for i in range(len(bits)):
        place = min(max(bits[i], 0), _ONE)  # from 0 up, floats sort as their bits
        knot = place >> _STEP
        low, high = curve[knot], curve[knot + 1]
        line[i] = low + (high - low) * (np.float32(place & ((1 << _STEP) - 1)) * part)
    for x in range(len(red)):
        red[x], green[x], blue[x] = line[3 * x], line[3 * x + 1], line[3 * x + 2]


@compiled(parallel=True)
def _fill(bits, chosen, curve, window, pad, taps, planes, portion):  # type: ignore[no-untyped-def]
    for view in rounds(len(chosen), portion):
        _fill_view(bits[chosen[view, 0], chosen[view, 1]], curve, window, pad, taps, planes[view])


@compiled(parallel=True)
def _fill_colours(bits, chosen, curve, pad, planes, means, portion):  # type: ignore[no-untyped-def]
    for view in rounds(len(chosen), portion):
        source = bits[chosen[view, 0], chosen[view, 1]]
        height, width = source.shape[0], source.shape[1] // 3
        inside = planes[view, :, pad:pad + height, pad:pad + width]
        line = np.empty(3 * width, np.float32)
        total = 0.0
        for y in range(height):
            row = pad + y
            _encode(source[y], curve, line, planes[view, 0, row, pad:pad + width],
                    planes[view, 1, row, pad:pad + width], planes[view, 2, row, pad:pad + width])
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


@compiled(inner=True)
def mirrored(place, count):  # type: ignore[no-untyped-def]
    """The index within 0..count-1 that a place outside mirrors; the end where that is outside."""
    return min(max(min(abs(place), 2 * (count - 1) - place), 0), count - 1)


@compiled(inner=True)
def _mirror(plane, pad):  # type: ignore[no-untyped-def]
    """Mirror the picture within, at its border's pixels, into the `pad` px around."""
    height, width = plane.shape[0] - 2 * pad, plane.shape[1] - 2 * pad
    for y in range(pad, height + pad):
        row = plane[y]
        for x in range(pad):
            row[x] = row[pad + mirrored(x - pad, width)]
            row[width + pad + x] = row[pad + mirrored(width + x, width)]
    for y in range(pad):
        copy_row(plane[pad + mirrored(y - pad, height)], plane[y])
        copy_row(plane[pad + mirrored(height + y, height)], plane[height + pad + y])


@compiled(inner=True)
def _fill_view(bits, curve, window, pad, taps, planes):  # type: ignore[no-untyped-def]
    """One view, a row at a time: what rows are made from stays near the core.

    taps: outer, next and middle weight of the smoothing along both axes.
    """
    left, top, width, height = window
    line = np.empty(3 * width, np.float32)
    colours = np.empty((3, width + 4), np.float32)
    across = np.empty((5, 3, width), np.float32)  # the last rows, smoothed along x
    luminance = np.empty((3, width), np.float32)  # the last rows
    last, end = height - 1, pad + width
    for y in range(height + 3):
        if y < height:
            # Rows are cut out one by one: of a slice of several the compiler would not know that
            # pixels lie side by side.
            _encode(bits[top + y, 3 * left:3 * (left + width)], curve, line,
                    colours[0, 2:width + 2], colours[1, 2:width + 2], colours[2, 2:width + 2])
            for channel in range(3):
                _smooth_across(colours[channel], taps, across[y % 5, channel])
        row = y - 2
        if 0 <= row < height:
            out = planes[pad + row]
            for channel in range(3):
                _smooth_down(across[max(row - 2, 0) % 5, channel],
                             across[max(row - 1, 0) % 5, channel], across[row % 5, channel],
                             across[min(row + 1, last) % 5, channel],
                             across[min(row + 2, last) % 5, channel], taps, out[channel, pad:end])
            _mix(out[0, pad:end], out[1, pad:end], out[2, pad:end], luminance[row % 3])
        row = y - 3
        if row >= 0:
            out = planes[pad + row]
            _gradients(luminance[max(row - 1, 0) % 3], luminance[row % 3],
                       luminance[min(row + 1, last) % 3], out[3, pad:end], out[4, pad:end])
            for channel in range(5):
                out[channel, :pad] = out[channel, pad]
                out[channel, end:] = out[channel, end - 1]
    for channel in range(5):
        for y in range(pad):
            copy_row(planes[pad, channel], planes[y, channel])
        for y in range(pad + height, len(planes)):
            copy_row(planes[pad + last, channel], planes[y, channel])


@compiled(inner=True)
def _smooth_across(row, taps, out):  # type: ignore[no-untyped-def]
    """row: (width + 4,), its outer two columns to be filled here. out: (width,)."""
    outer, inner, middle = taps[0], taps[1], taps[2]
    width = len(out)
    row[:2] = row[2]
    row[width + 2:] = row[width + 1]
    for x in range(width):
        out[x] = (outer * (row[x] + row[x + 4]) + inner * (row[x + 1] + row[x + 3])
                  + middle * row[x + 2])


@compiled(inner=True)
def _smooth_down(a, b, c, d, e, taps, out):  # type: ignore[no-untyped-def]
    """Five rows to one, (width,) each."""
    outer, inner, middle = taps[0], taps[1], taps[2]
    for x in range(len(out)):
        out[x] = outer * (a[x] + e[x]) + inner * (b[x] + d[x]) + middle * c[x]


@compiled(inner=True)
def _mix(red, green, blue, luminance):  # type: ignore[no-untyped-def]
    for x in range(len(luminance)):
        luminance[x] = LUMINANCE[0] * red[x] + LUMINANCE[1] * green[x] + LUMINANCE[2] * blue[x]


@compiled(inner=True)
def _gradients(above, row, below, across, along):  # type: ignore[no-untyped-def]
    """Central differences along x and y; x goes on at the border."""
    half, last = np.float32(0.5), len(row) - 1
    for x in range(1, last):
        across[x] = half * (row[x + 1] - row[x - 1])
    across[0] = half * (row[min(1, last)] - row[0])
    across[last] = half * (row[last] - row[max(last - 1, 0)])
    for x in range(len(row)):
        along[x] = half * (below[x] - above[x])


@compiled(inner=True)
def _smooth(plane):  # type: ignore[no-untyped-def]
    """Through `sampling.SMOOTHER` along both axes, the border going on, in place."""
    height, width = plane.shape
    line = np.empty(width + 4, np.float32)
    across = np.empty((height, width), np.float32)
    for y in range(height):
        copy_row(plane[y], line[2:width + 2])
        _smooth_across(line, _SMOOTHER, across[y])
    last = height - 1
    for y in range(height):
        _smooth_down(across[max(y - 2, 0)], across[max(y - 1, 0)], across[y],
                     across[min(y + 1, last)], across[min(y + 2, last)], _SMOOTHER, plane[y])
