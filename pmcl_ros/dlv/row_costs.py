"""Costs of a row of single pixels at all labels, summed over the views.

Costs are kept as what they differ from the same pair's cost at label 0, and the sum of the latter.
A likelihood is made of differences between labels, which on flat or noisy pixels are a thousandth
of a cost: of rounded costs they would keep four digits, or three.
"""

import numpy as np

from pmcl_ros.dlv.samples import sample_row
from pmcl_ros.dlv.sampling import TAPS
from pmcl_ros.kernels import compiled

# Pixels of a row worked on at once. Their costs at all labels stay near the core; an odd multiple
# of a cache line, so that the rows of a tile neither straddle lines nor compete for the same ones.
_TILE = 336
_FIRST = 15 * _TILE  # of a pair's coefficients, five channels of three: its costs at label 0


@compiled()
def row_costs(planes, where, cells, taps, time,  # type: ignore[no-untyped-def]
              weights, limits, inside, left, top, stride, l2, row, out):
    """Costs of one row of the lattice, (labels + 1, width): differences, then those of label 0.

    left, top: where the lattice's first pixel lies in the planes [px]; the rest as in `Matching`.
    """
    labels, width = len(out) - 1, out.shape[1]
    tiles = -(-width // _TILE)
    length = min(-(-width // (16 * tiles)) * 16, width)  # whole vectors where there is room
    total = np.empty(labels * _TILE, np.float32)
    summed = np.empty(_TILE, np.float32)
    quadratics = np.empty(16 * _TILE, np.float32)
    nodes = np.empty((5, 3, _TILE), np.float32)
    centre = np.empty((5, _TILE), np.float32)
    between = np.empty(stride * _TILE + TAPS, np.float32)
    y = top + stride * row
    for tile in range(tiles):
        start = min(tile * length, width - length)  # the last tile overlaps the one before
        total[:] = 0
        summed[:] = 0
        for channel in range(5):
            for i in range(length):
                centre[channel, i] = planes[0, channel, y, left + stride * (start + i)]
        kept = -1  # the node whose samples are in the last of the three places
        for run in range(len(where)):
            pair, label, end, node = where[run]
            first = max(inside[pair, 0], start)
            count = min(inside[pair, 1], start + length) - first
            if count <= 0 or row < inside[pair, 2] or row >= inside[pair, 3]:
                continue
            x, offset = left + stride * first, first - start
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
            if label == 0:
                _begin(l2, quadratics, time[pair, 0], limits[pair],
                       summed[offset:offset + count], count)
            while label < end:
                several = 3 if label + 3 <= end else 1
                _add(l2, quadratics, time[pair, label:label + several], limits[pair],
                     total[label * _TILE + offset:(label + several) * _TILE], count)
                label += several
        for label in range(labels):
            out[label, start:start + length] = total[label * _TILE:label * _TILE + length]
        out[labels, start:start + length] = summed[:length]


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
def _begin(l2, quadratics, time, limits, summed, length):  # type: ignore[no-untyped-def]
    """One pair's cost at label 0."""
    q, colour, across, along = quadratics, limits[0], limits[1], limits[2]
    for i in range(length):
        if l2:
            first = _l2(q, i, time, colour, across, along)
        else:
            first = _sad(q, i, time, colour, across, along)
        q[_FIRST + i] = first
        summed[i] += first


@compiled()
def _add(l2, quadratics, times, limits, sums, length):  # type: ignore[no-untyped-def]
    """Add one pair's cost, less that at label 0, at one label, or at three, for which the
    coefficients are read once."""
    q, colour, across, along = quadratics, limits[0], limits[1], limits[2]
    if len(times) == 3:
        t0, t1, t2 = times[0], times[1], times[2]
        if l2:
            for i in range(length):
                first = _l2(q, i, t0, colour, across, along) - q[_FIRST + i]
                second = _l2(q, i, t1, colour, across, along) - q[_FIRST + i]
                third = _l2(q, i, t2, colour, across, along) - q[_FIRST + i]
                sums[i] += first
                sums[_TILE + i] += second
                sums[2 * _TILE + i] += third
        else:
            for i in range(length):
                first = _sad(q, i, t0, colour, across, along) - q[_FIRST + i]
                second = _sad(q, i, t1, colour, across, along) - q[_FIRST + i]
                third = _sad(q, i, t2, colour, across, along) - q[_FIRST + i]
                sums[i] += first
                sums[_TILE + i] += second
                sums[2 * _TILE + i] += third
    elif l2:
        for i in range(length):
            sums[i] += _l2(q, i, times[0], colour, across, along) - q[_FIRST + i]
    else:
        for i in range(length):
            sums[i] += _sad(q, i, times[0], colour, across, along) - q[_FIRST + i]


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
