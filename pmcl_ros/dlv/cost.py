"""The cost volume with bilinear sampling, fast.

While a view's displacement stays in one cell of the pixel grid, its bilinear sample minus the
centre view's pixel is a quadratic in the label's disparity. Three coefficients for each pixel,
view, cell and channel serve all the labels in the cell: two multiplications each, instead of four
reads and a weighing. It is exact; `reference` is the plain form.
"""

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.planes import matching_planes
from pmcl_ros.dlv.runs import Runs
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.kernels import LOCK, compiled
from pmcl_ros.lightfield.light_field import LightField

# Pixels of a row worked on at once. Their costs at all labels stay near the core; an odd multiple
# of a cache line, so that the rows of a tile neither straddle lines nor compete for the same ones.
_TILE = 336


def cost_volume(light_field: LightField, depths: NDArray[np.float64],
                settings: DlvSettings) -> NDArray[np.float32]:
    """C(x, l) of the paper's section V.A, (labels, height, width) float32.

    depths: (labels,) [m], monotone. The values are those of `reference.cost_volume` with bilinear
    sampling, whatever `settings.interpolation` says. Needs time in proportion to views and labels.
    Raises VolumeError when no two views have light, or the depths shift views out of the image.
    """
    pairs = StereoPairs.of(light_field.grid, settings.views)
    shifts = pairs.shifts(depths)
    runs = Runs.of(shifts, depths)
    # The weights of the terms are folded into the coefficients and the truncations.
    gradient = 1 - settings.beta
    weights = np.stack([np.full_like(pairs.gamma, settings.beta), gradient * pairs.gamma,
                        gradient * (1 - pairs.gamma)], axis=1).astype(np.float32)
    limits = weights * np.array([settings.tau_color, settings.tau_gradient, settings.tau_gradient],
                                np.float32)
    pad = int(np.ceil(np.abs(shifts).max())) + 1
    planes = matching_planes(light_field, pairs.indices, pad)
    pinhole = light_field.grid.pinhole
    cost = np.empty((len(depths), pinhole.height, pinhole.width), np.float32)
    with LOCK:
        _match(planes, pad, runs.where, runs.origin, runs.slope, runs.time, weights, limits,
               settings.color_cost == 'l2', cost)
        if settings.window > 1:
            _sum_windows(cost, settings.window // 2)
    return cost


@compiled(parallel=True)
def _match(planes, pad, where, origin, slope, time,  # type: ignore[no-untyped-def]
           weights, limits, l2, cost):
    """Costs of single pixels, summed over the views: row by row, a tile of the row at a time."""
    labels, height, width = cost.shape
    tiles = -(-width // _TILE)
    length = min(-(-width // (16 * tiles)) * 16, width)  # whole vectors where there is room
    for y in prange(height):
        total = np.empty(labels * _TILE, np.float32)
        quadratics = np.empty(15 * _TILE, np.float32)
        for tile in range(tiles):
            left = min(tile * length, width - length)  # the last tile overlaps the one before
            total[:] = 0
            for run in range(len(where)):
                pair, label, end, cell_x, cell_y = where[run]
                top, start = y + pad + cell_y, left + pad + cell_x
                for channel in range(5):
                    _fit(planes[0, channel, y + pad, left + pad:left + pad + length],
                         planes[pair + 1, channel, top, start:start + length + 1],
                         planes[pair + 1, channel, top + 1, start:start + length + 1],
                         origin[run], slope[run], weights[pair, max(channel - 2, 0)],
                         quadratics[3 * channel * _TILE:3 * (channel + 1) * _TILE], length)
                while label < end:
                    count = 3 if label + 3 <= end else 1
                    _add(l2, quadratics, time[pair, label:label + count], limits[pair],
                         total[label * _TILE:(label + count) * _TILE], length)
                    label += count
            for label in range(labels):
                cost[label, y, left:left + length] = total[label * _TILE:label * _TILE + length]


@compiled()
def _fit(centre, upper, lower, origin, slope,  # type: ignore[no-untyped-def]
         weight, out, length):
    """The quadratics in time of one channel: the constants, then the slopes, the curvatures."""
    x, y, u, v = origin[0], origin[1], slope[0], slope[1]
    xy, twist, bend = x * y, x * v + y * u, u * v
    for i in range(length):
        corner = upper[i]
        right = upper[i + 1] - corner
        down = lower[i] - corner
        cross = lower[i + 1] - lower[i] - right
        out[i] = weight * (corner - centre[i] + x * right + y * down + xy * cross)
        out[_TILE + i] = weight * (u * right + v * down + twist * cross)
        out[2 * _TILE + i] = weight * (bend * cross)


@compiled()
def _add(l2, quadratics, times, limits, sums, length):  # type: ignore[no-untyped-def]
    """Add one pair's cost at one label, or at three, for which the coefficients are read once."""
    q, colour, across, along = quadratics, limits[0], limits[1], limits[2]
    if len(times) == 3:
        t0, t1, t2 = times[0], times[1], times[2]
        if l2:
            for i in range(length):
                first = _l2(q, i, t0, colour, across, along)
                second = _l2(q, i, t1, colour, across, along)
                third = _l2(q, i, t2, colour, across, along)
                sums[i] += first
                sums[_TILE + i] += second
                sums[2 * _TILE + i] += third
        else:
            for i in range(length):
                first = _sad(q, i, t0, colour, across, along)
                second = _sad(q, i, t1, colour, across, along)
                third = _sad(q, i, t2, colour, across, along)
                sums[i] += first
                sums[_TILE + i] += second
                sums[2 * _TILE + i] += third
    elif l2:
        for i in range(length):
            sums[i] += _l2(q, i, times[0], colour, across, along)
    else:
        for i in range(length):
            sums[i] += _sad(q, i, times[0], colour, across, along)


@compiled()
def _l2(q, i, time, colour, across, along):  # type: ignore[no-untyped-def]
    red, green, blue = _at(q, i, 0, time), _at(q, i, 1, time), _at(q, i, 2, time)
    distance = np.sqrt(red * red + green * green + blue * blue)
    return _lesser(distance, colour) + _gradient(q, i, time, across, along)


@compiled()
def _sad(q, i, time, colour, across, along):  # type: ignore[no-untyped-def]
    distance = abs(_at(q, i, 0, time)) + abs(_at(q, i, 1, time)) + abs(_at(q, i, 2, time))
    return _lesser(distance, colour) + _gradient(q, i, time, across, along)


@compiled()
def _gradient(q, i, time, across, along):  # type: ignore[no-untyped-def]
    return _lesser(abs(_at(q, i, 3, time)), across) + _lesser(abs(_at(q, i, 4, time)), along)


@compiled()
def _at(q, i, channel, time):  # type: ignore[no-untyped-def]
    place = 3 * channel * _TILE + i
    return q[place] + time * (q[place + _TILE] + time * q[place + 2 * _TILE])


@compiled()
def _lesser(a, b):  # type: ignore[no-untyped-def]
    return a if a < b else b


@compiled(parallel=True)
def _sum_windows(cost, half):  # type: ignore[no-untyped-def]
    """Sum over the window R_x, cut off at the image's border, in place."""
    labels, height, width = cost.shape
    for label in prange(labels):
        plane = cost[label]
        padded = np.zeros((height + 2 * half, width + 2 * half), np.float32)
        for y in range(height):
            padded[half + y, half:half + width] = plane[y]
        for y in range(height):
            plane[y] = 0
            for k in range(2 * half + 1):
                row = padded[y + k]
                for x in range(width):
                    plane[y, x] += row[half + x]
        for y in range(height):
            row = padded[half + y]
            row[half:half + width] = plane[y]
            plane[y] = 0
            for k in range(2 * half + 1):
                for x in range(width):
                    plane[y, x] += row[k + x]
