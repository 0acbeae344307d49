"""The cost volume, fast.

While a view's displacement stays within about a pixel its samples are quadratics in the label's
disparity: exactly, if they are bilinear and stay in a cell of the pixel grid, and nearly so if
they are noise-neutral (`sampling`). The view is sampled at three nodes; the three coefficients
through them, for each pixel and channel, serve all the labels of the run: two multiplications each
instead of a sample. `reference` is the plain form.
"""

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.dlv.matching import Matching
from pmcl_ros.dlv.sampling import TAPS
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.kernels import LOCK, compiled
from pmcl_ros.lightfield.light_field import LightField

# Pixels of a row worked on at once. Their costs at all labels stay near the core; an odd multiple
# of a cache line, so that the rows of a tile neither straddle lines nor compete for the same ones.
_TILE = 336


def cost_volume(light_field: LightField, depths: NDArray[np.float64],
                settings: DlvSettings) -> NDArray[np.float32]:
    """C(x, l) of the paper's section V.A, (labels, height, width) float32.

    depths: (labels,) [m], monotone. height and width are those of `Lattice.of` the settings. The
    values are those of `reference.cost_volume`; interpolation 'phase' has no fast form. Needs time
    in proportion to views, labels and pixels. Raises VolumeError when no two views have light, the
    depths shift views out of the image, or the crop is not in it.
    """
    task = Matching.of(light_field, depths, settings)
    lattice, runs = task.lattice, task.runs
    cost = np.empty(task.shape, np.float32)
    with LOCK:
        _match(task.planes, task.pad, runs.where, runs.cells, runs.taps, runs.time,
               task.weights, task.limits, task.inside, lattice.left, lattice.top, lattice.stride,
               settings.color_cost == 'l2', cost)
        if task.half:
            _sum_windows(cost, task.half)
    rows, columns = task.wanted.within(lattice)
    return np.ascontiguousarray(cost[:, rows, columns])


@compiled(parallel=True)
def _match(planes, pad, where, cells, taps, time,  # type: ignore[no-untyped-def]
           weights, limits, inside, left, top, stride, l2, cost):
    """Costs of single pixels, summed over the views: row by row, a tile of the row at a time."""
    labels, height, width = cost.shape
    tiles = -(-width // _TILE)
    length = min(-(-width // (16 * tiles)) * 16, width)  # whole vectors where there is room
    for row in prange(height):
        total = np.empty(labels * _TILE, np.float32)
        quadratics = np.empty(15 * _TILE, np.float32)
        nodes = np.empty((5, 3, _TILE), np.float32)
        centre = np.empty((5, _TILE), np.float32)
        between = np.empty(stride * _TILE + TAPS, np.float32)
        y = top + stride * row + pad
        for tile in range(tiles):
            start = min(tile * length, width - length)  # the last tile overlaps the one before
            total[:] = 0
            for channel in range(5):
                for i in range(length):
                    centre[channel, i] = planes[0, channel, y, left + stride * (start + i) + pad]
            kept = -1  # the node whose samples are in the last of the three places
            for run in range(len(where)):
                pair, label, end, node = where[run]
                first = max(inside[pair, 0], start)
                count = min(inside[pair, 1], start + length) - first
                if count <= 0 or row < inside[pair, 2] or row >= inside[pair, 3]:
                    continue
                x, offset = left + stride * first + pad, first - start
                for channel in range(5):
                    here = nodes[channel]
                    view = planes[pair + 1, channel]
                    if node == kept:
                        here[0, :count] = here[2, :count]
                    else:
                        sample_row(view, x + cells[node, 0], y + cells[node, 1], taps[node],
                                   stride, between, here[0], count)
                    for k in range(1, 3):
                        sample_row(view, x + cells[node + k, 0], y + cells[node + k, 1],
                                   taps[node + k], stride, between, here[k], count)
                    _fit(centre[channel, offset:offset + count], here,
                         weights[pair, max(channel - 2, 0)],
                         quadratics[3 * channel * _TILE:3 * (channel + 1) * _TILE], count)
                kept = node + 2
                while label < end:
                    several = 3 if label + 3 <= end else 1
                    _add(l2, quadratics, time[pair, label:label + several], limits[pair],
                         total[label * _TILE + offset:(label + several) * _TILE], count)
                    label += several
            for label in range(labels):
                cost[label, row, start:start + length] = total[
                    label * _TILE:label * _TILE + length]


@compiled()
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


@compiled()
def _fit(centre, nodes, weight, out, count):  # type: ignore[no-untyped-def]
    """The quadratics in time of one channel: the constants, then the slopes, the curvatures."""
    begin, middle, end = nodes[0], nodes[1], nodes[2]
    two, four = np.float32(2), np.float32(4)
    for i in range(count):
        half, whole = middle[i] - begin[i], end[i] - begin[i]
        out[i] = weight * (begin[i] - centre[i])
        out[_TILE + i] = weight * (four * half - whole)
        out[2 * _TILE + i] = weight * two * (whole - two * half)


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
