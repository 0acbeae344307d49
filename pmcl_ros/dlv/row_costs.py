"""Costs of a row of single pixels at all labels, summed over the views.

Costs are kept as what they differ from the same pair's cost at label 0, and the sum of the latter.
A likelihood is made of differences between labels, which on flat or noisy pixels are a thousandth
of a cost: of rounded costs they would keep four digits, or three.
"""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.sampling import TAPS, copy_row, sample_row
from pmcl_ros.runtime.kernels import compiled

# Pixels worked on at once: as many as the widest vectors hold, so that no loop has a remainder.
LANES = 16
# A block's numbers, each LANES times: five channels' three coefficients, its pair's cost at label
# 0. A block's places are then known to the compiler, and its numbers lie side by side.
_BLOCK = 16 * LANES
_FIRST = 15 * LANES


def aligned_zeros(*shape: int) -> NDArray[np.float32]:
    """float32 that begin at a cache line: in rows of whole lines no vector straddles two."""
    count = int(np.prod(shape))
    room = np.zeros(count + LANES, np.float32)
    start = -(room.ctypes.data // room.itemsize) % LANES
    return room[start:start + count].reshape(shape)


def coefficient_count(width: int) -> int:
    """How many numbers `row_costs` needs to work on a row of so many pixels."""
    return -(-width // LANES) * _BLOCK


@compiled(inner=True)
def row_costs(planes, where, cells, taps, time,  # type: ignore[no-untyped-def]
              weights, limits, inside, left, top, stride, l2, row, width, quadratics, margin, out):
    """Costs of one row of the lattice, (labels + 1, width): differences, then those of label 0.

    left, top: where the lattice's first pixel lies in the planes [px]; the rest as in
    `CostInputs`. quadratics: of `coefficient_count`, to work in. out: (labels + 1, whole blocks
    and a margin on each side), 0 beyond the width.
    """
    columns = planes.shape[3]
    rows = planes.reshape(len(planes), planes.shape[1], 5 * columns)
    labels, stop_at = len(out) - 1, out.shape[1] - margin
    length = stop_at - margin
    nodes = np.zeros((3, 5 * columns), np.float32)
    centre = np.zeros(5 * columns, np.float32)
    scale = np.zeros(5 * columns, np.float32)
    between = np.empty(5 * columns + TAPS, np.float32)
    y = top + stride * row
    for channel in range(5):
        for i in range(width):
            centre[channel * columns + i] = planes[0, y, channel, left + stride * i]
    out[:] = 0
    scaled = kept = -1  # the pair that `scale` is of; the node of which the last samples are
    for run in range(len(where)):
        pair, label, end, node = where[run]
        first, stop = inside[pair, 0], inside[pair, 1]
        if first >= stop or row < inside[pair, 2] or row >= inside[pair, 3]:
            continue
        if pair != scaled:
            _scale(weights[pair], first, stop, columns, scale)
            scaled = pair
        if node == kept:
            copy_row(nodes[2], nodes[0])
        for k in range(1 if node == kept else 0, 3):
            _sample(rows[pair + 1], left + stride * first + cells[node + k, 0],
                    y + cells[node + k, 1], taps[node + k], stride, columns, between,
                    nodes[k, first:], stop - first)
        kept = node + 2
        for channel in range(5):
            here = slice(channel * columns, channel * columns + length)
            _fit(centre[here], nodes[0, here], nodes[1, here], nodes[2, here], scale[here],
                 quadratics[3 * LANES * channel:])
        if label == 0:
            _begin(l2, quadratics, time[pair, 0], limits[pair], out[labels, margin:stop_at])
        _add(l2, quadratics, time[pair], limits[pair], label, end, margin, stop_at, out)


@compiled(inner=True)
def _scale(weights, first, stop, columns, scale):  # type: ignore[no-untyped-def]
    """Each channel's weight at the pixels for which the pair counts, 0 at the others."""
    scale[:] = 0
    for channel in range(5):
        scale[channel * columns + first:channel * columns + stop] = weights[max(channel - 2, 0)]


@compiled(inner=True)
def _sample(rows, x, y, taps, stride, columns, between, out, count):  # type: ignore[no-untyped-def]
    """`count` samples of each channel. Neighbours are sampled as one row, what is between the
    channels too."""
    if stride == 1:
        sample_row(rows, x, y, taps, 1, between, out, 4 * columns + count)
    else:
        for channel in range(5):
            sample_row(rows, channel * columns + x, y, taps, stride, between,
                       out[channel * columns:], count)


@compiled(inner=True)
def _fit(centre, begin, middle, end, scale, out):  # type: ignore[no-untyped-def]
    """The quadratics in time of one channel: their constants, slopes and curvatures.

    out: from the channel's place in the first block on.
    """
    two, four = np.float32(2), np.float32(4)
    for block in range(len(centre) // LANES):
        for lane in range(LANES):
            i, k = LANES * block + lane, _BLOCK * block + lane
            half, whole = middle[i] - begin[i], end[i] - begin[i]
            out[k] = scale[i] * (begin[i] - centre[i])
            out[k + LANES] = scale[i] * (four * half - whole)
            out[k + 2 * LANES] = scale[i] * two * (whole - two * half)


@compiled(inner=True)
def _begin(l2, q, time, limits, sums):  # type: ignore[no-untyped-def]
    """Add one pair's cost at label 0, and keep it with the coefficients."""
    colour, across, along = limits[0], limits[1], limits[2]
    for block in range(len(sums) // LANES):
        i = _BLOCK * block
        if l2:
            for lane in range(LANES):
                q[i + lane + _FIRST] = _l2(q, i + lane, time, colour, across, along)
        else:
            for lane in range(LANES):
                q[i + lane + _FIRST] = _sad(q, i + lane, time, colour, across, along)
        for lane in range(LANES):
            sums[LANES * block + lane] += q[i + lane + _FIRST]


@compiled(inner=True)
def _add(l2, q, times, limits, label, end, margin, stop, sums):  # type: ignore[no-untyped-def]
    """Add one pair's cost, less that at label 0, at the labels of a run, three at a time: for
    these the coefficients are read once."""
    while label + 3 <= end:
        first, second, third = (sums[label, margin:stop], sums[label + 1, margin:stop],
                                sums[label + 2, margin:stop])
        if l2:
            _add_three_l2(q, times[label:label + 3], limits, first, second, third)
        else:
            _add_three_sad(q, times[label:label + 3], limits, first, second, third)
        label += 3
    while label < end:
        if l2:
            _add_l2(q, times[label], limits, sums[label, margin:stop])
        else:
            _add_sad(q, times[label], limits, sums[label, margin:stop])
        label += 1


# A form for each distance: a branch in these loops keeps them from being vectorised, and takes 13
# times as long; machine code of kernels that are passed to kernels cannot be kept on disk.

@compiled(inner=True)
def _add_three_l2(q, times, limits, first, second, third):  # type: ignore[no-untyped-def]
    colour, across, along = limits[0], limits[1], limits[2]
    t0, t1, t2 = times[0], times[1], times[2]
    for block in range(len(first) // LANES):
        for lane in range(LANES):
            i, x = _BLOCK * block + lane, LANES * block + lane
            base = q[i + _FIRST]
            a = _l2(q, i, t0, colour, across, along) - base
            b = _l2(q, i, t1, colour, across, along) - base
            c = _l2(q, i, t2, colour, across, along) - base
            first[x] += a
            second[x] += b
            third[x] += c


@compiled(inner=True)
def _add_l2(q, time, limits, sums):  # type: ignore[no-untyped-def]
    colour, across, along = limits[0], limits[1], limits[2]
    for block in range(len(sums) // LANES):
        for lane in range(LANES):
            i, x = _BLOCK * block + lane, LANES * block + lane
            sums[x] += _l2(q, i, time, colour, across, along) - q[i + _FIRST]


@compiled(inner=True)
def _add_three_sad(q, times, limits, first, second, third):  # type: ignore[no-untyped-def]
    colour, across, along = limits[0], limits[1], limits[2]
    t0, t1, t2 = times[0], times[1], times[2]
    for block in range(len(first) // LANES):
        for lane in range(LANES):
            i, x = _BLOCK * block + lane, LANES * block + lane
            base = q[i + _FIRST]
            a = _sad(q, i, t0, colour, across, along) - base
            b = _sad(q, i, t1, colour, across, along) - base
            c = _sad(q, i, t2, colour, across, along) - base
            first[x] += a
            second[x] += b
            third[x] += c


@compiled(inner=True)
def _add_sad(q, time, limits, sums):  # type: ignore[no-untyped-def]
    colour, across, along = limits[0], limits[1], limits[2]
    for block in range(len(sums) // LANES):
        for lane in range(LANES):
            i, x = _BLOCK * block + lane, LANES * block + lane
            sums[x] += _sad(q, i, time, colour, across, along) - q[i + _FIRST]


@compiled(inner=True)
def _l2(q, i, time, colour, across, along):  # type: ignore[no-untyped-def]
    red, green, blue = _at(q, i, 0, time), _at(q, i, 1, time), _at(q, i, 2, time)
    distance = np.sqrt(red * red + green * green + blue * blue)
    return _lesser(distance, colour) + _gradient(q, i, time, across, along)


@compiled(inner=True)
def _sad(q, i, time, colour, across, along):  # type: ignore[no-untyped-def]
    distance = abs(_at(q, i, 0, time)) + abs(_at(q, i, 1, time)) + abs(_at(q, i, 2, time))
    return _lesser(distance, colour) + _gradient(q, i, time, across, along)


@compiled(inner=True)
def _gradient(q, i, time, across, along):  # type: ignore[no-untyped-def]
    return _lesser(abs(_at(q, i, 3, time)), across) + _lesser(abs(_at(q, i, 4, time)), along)


@compiled(inner=True)
def _at(q, i, channel, time):  # type: ignore[no-untyped-def]
    k = i + 3 * LANES * channel
    return q[k] + time * (q[k + LANES] + time * q[k + 2 * LANES])


@compiled(inner=True)
def _lesser(a, b):  # type: ignore[no-untyped-def]
    return a if a < b else b
