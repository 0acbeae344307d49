"""Colours under each lenslet: demosaicing within the lenslet's own disc.

All samples of a lenslet lie whole pixels apart, so they share one sub-pixel phase, and the sums
are separable: along the sensor's rows first, then along its columns. Many lenslets are summed at
once.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.runtime.kernels import compiled, rounds

DARKEST = 0.05  # of the light at a lenslet's centre: less holds more noise than picture
# Lenslets of a row that are summed at once, with contiguous writes of samples.
# The compiler must see that the lines of lanes in an array do not overlap: it does when their
# distance is a constant and indices have no sign.
_LANES = 384
_LINE = np.uint64(_LANES)
_BAND = 8  # rows of lenslets that a task sums


@dataclass(frozen=True)
class Lenslets:
    """A block of the lattice's lenslets.

    origin: indices (j, i) of its first lenslet.
    centres: (rows, columns, 2) raw px (column, row).
    radius: of their discs [raw px]; they touch each other.
    """

    origin: tuple[int, int]
    centres: NDArray[np.float64]
    radius: float

    @classmethod
    def covering(cls, lattice: Lattice, left: float, right: float, top: float,
                 bottom: float) -> 'Lenslets':
        """The corners of all cells of the lattice in a part of the sensor's plane [raw px]."""
        corners = np.array([[x, y] for x in (left, right) for y in (top, bottom)])
        x, y = (corners - lattice.centre_px).T
        cos, sin = math.cos(lattice.rotation), math.sin(lattice.rotation)
        along = (cos * x + sin * y) / lattice.pitch_px
        across = (cos * y - sin * x) / lattice.row_step_px
        i0, i1 = math.floor(along.min()) - 2, math.floor(along.max()) + 4
        j0, j1 = math.floor(across.min()) - 1, math.floor(across.max()) + 3
        i, j = np.meshgrid(np.arange(i0, i1), np.arange(j0, j1))
        return cls((j0, i0), lattice.centres(i, j), lattice.pitch_px / 2)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.centres.shape[:2]
        return rows, columns

    def nearest(self, lattice: Lattice, places: NDArray[np.floating]) -> NDArray[np.int64]:
        """(n, 2) row and column in the block of the lenslets next to places (n, 2) [raw px]."""
        i, j = lattice.nearest(places)
        return np.stack([j, i], axis=-1) - self.origin


def sum_lenslets(counts: NDArray[np.uint16], black: float, lenslets: Lenslets,
                 views: NDArray[np.int64], half: int, factors: NDArray[np.float32],
                 scale: float, out: NDArray[np.float32]) -> None:
    """The sums `scale factor sum w m (count - black)` of red, green and blue under every lenslet.

    counts: (height, width) BGGR, width even.
    views: (n, 2) row and column, 0..2 half, of the offsets (column - half, row - half) [raw px].
    factors: (rows, n, 3, columns) float32.
    out: (rows, n, 3, columns) float32, is filled.

    w is a tent of 2 px radius around the offset, over the pixels of the colour, of sum 1; m is a
    pixel's part in the lenslet's disc, as another lenslet's pixels see another part of the scene.
    """
    slots = np.full((2 * half + 1, 2 * half + 1), -1)
    slots[views[:, 0], views[:, 1]] = np.arange(len(views))
    pairs = np.ascontiguousarray(counts).view(np.uint32)
    factors = factors.reshape(-1)
    factors.flags.writeable = False  # as some already are: one kernel serves both
    _sum(pairs, np.float32(black), np.ascontiguousarray(lenslets.centres),
         np.float32(lenslets.radius), slots, factors, np.float32(scale), out.reshape(-1))


@compiled(parallel=True)
def _sum(pairs, black, centres, radius, slots, factors, scale, out, portion):  # type: ignore[no-untyped-def]
    rows, columns = centres.shape[:2]
    blocks = -(-columns // _LANES)
    block = -(-columns // (16 * blocks)) * 16  # whole vectors
    side = slots.shape[0]
    pixels, sums = (side + 4) * (side + 5), (side + 4) * side * 2
    for band in rounds(-(-rows // _BAND), portion):
        words = np.zeros(pixels * _LANES, np.uint16)
        patch = np.empty(pixels * _LANES, np.float32)
        across = np.empty(sums * _LANES, np.float32)
        small = np.zeros(15 * _LANES, np.float32)
        for row in range(band * _BAND, min((band + 1) * _BAND, rows)):
            for left in range(0, columns, block):
                _sum_block(pairs, black, centres, radius, slots, factors, scale, out, row, left,
                           block, words, patch, across, small)


@compiled(inner=True)
def _sum_block(pairs, black, centres, radius, slots, factors, scale, out,  # type: ignore[no-untyped-def]
               row, left, block, words, patch, across, small):
    columns = centres.shape[1]
    side, views = slots.shape[0], slots.max() + 1
    down, wide = side + 4, side + 5  # of the pixels around a centre, from an even place on
    used = min(block, columns - left)
    place, sums, weights = small[:2 * _LANES], small[2 * _LANES:5 * _LANES], small[5 * _LANES:]
    _gather(pairs, black, centres[row, left:left + used], side, words.view(np.uint32), place)
    for v in range(down):
        for u in range(0, wide, 2):
            _mask(words, black, np.float32(u), np.float32(v), place, radius, patch,
                  np.uint64((v * wide + u) * _LANES), block)
    for axis in range(2):
        _weigh(place[axis * _LANES:(axis + 1) * _LANES], np.float32(side // 2 + 1),
               weights[5 * axis * _LANES:5 * (axis + 1) * _LANES])
    for v in range(down):
        for a in range(side):
            to = (v * side + a) * 2
            _columns(patch, np.uint64((v * wide + a) * _LANES), weights, across,
                     np.uint64((to + a % 2) * _LANES), np.uint64((to + 1 - a % 2) * _LANES), block)
    for b in range(side):
        for a in range(side):
            if slots[b, a] >= 0:
                _rows(across, np.uint64((b * side + a) * 2 * _LANES),
                      np.uint64(2 * side * _LANES), b % 2, weights, sums, block)
                for colour in range(3):
                    line = (row * views + slots[b, a]) * 3 + colour
                    _write(sums, np.uint64(colour * _LANES), factors, scale, out,
                           np.uint64(line * columns + left), used)


@compiled(inner=True)
def _gather(pairs, black, centres, side, words, place):  # type: ignore[no-untyped-def]
    """The pixels around each centre, two in a word, and where in them it lies, x, then y."""
    height, width = pairs.shape
    across, down, before = (side + 5) // 2, side + 4, side // 2 + 1
    outside = np.uint32(black) * np.uint32(65537)
    for k in range(len(centres)):
        x = (int(np.floor(centres[k, 0])) - before) // 2
        y = (int(np.floor(centres[k, 1])) - before) // 2 * 2
        place[k], place[_LANES + k] = centres[k, 0] - 2 * x, centres[k, 1] - y
        if x >= 0 and y >= 0 and x + across <= width and y + down <= height:
            for v in range(down):
                for u in range(across):
                    words[(v * across + u) * _LANES + k] = pairs[y + v, x + u]
        else:
            for v in range(down):
                for u in range(across):
                    inside = 0 <= x + u < width and 0 <= y + v < height
                    words[(v * across + u) * _LANES + k] = (pairs[y + v, x + u] if inside
                                                            else outside)


@compiled(inner=True)
def _mask(words, black, u, v, place, radius, patch, at, length):  # type: ignore[no-untyped-def]
    """Two pixels of each lane, without the black, times their parts in the disc.

    The disc's edge is a pixel wide; distances are compared squared.
    """
    one, zero, half = np.float32(1), np.float32(0), np.float32(0.5)
    steep = half / radius
    reach = half + half * radius
    for i in range(length):
        k = np.uint64(i)
        dx, dy = u - place[k], v - place[_LINE + k]
        rim = reach - steep * dy * dy
        first = rim - steep * dx * dx
        dx += one
        second = rim - steep * dx * dx
        first = one if first > one else first
        second = one if second > one else second
        first = zero if first < zero else first
        second = zero if second < zero else second
        patch[at + k] = (np.float32(words[at + k + k]) - black) * first
        patch[at + _LINE + k] = (np.float32(words[at + k + k + np.uint64(1)]) - black) * second


@compiled(inner=True)
def _weigh(place, before, weights):  # type: ignore[no-untyped-def]
    """The tents of all samples of a lenslet: over two pixels of a parity, or over three."""
    one, zero, half = np.float32(1), np.float32(0), np.float32(0.5)
    for k in range(_LANES):
        part = half * (place[k] - before)  # from 0 to 1
        middle = part - half
        weights[k], weights[_LANES + k] = one - part, part
        weights[2 * _LANES + k] = -middle if middle < zero else zero
        weights[3 * _LANES + k] = one - abs(middle)
        weights[4 * _LANES + k] = middle if middle > zero else zero


@compiled(inner=True)
def _columns(patch, at, w, across, three, two, length):  # type: ignore[no-untyped-def]
    """Sums along a row: over three pixels of one parity, and over the two between them."""
    for i in range(length):
        k = np.uint64(i)
        p, q, r = at + k, at + _LINE + k, at + _LINE + _LINE + k
        s, t = at + _LINE + _LINE + _LINE + k, at + _LINE + _LINE + _LINE + _LINE + k
        across[three + k] = (w[_LINE + _LINE + k] * patch[p]
                             + w[_LINE + _LINE + _LINE + k] * patch[r]
                             + w[_LINE + _LINE + _LINE + _LINE + k] * patch[t])
        across[two + k] = w[k] * patch[q] + w[_LINE + k] * patch[s]


@compiled(inner=True)
def _rows(across, at, step, odd, w, sums, length):  # type: ignore[no-untyped-def]
    """Sums along the columns, for red, green and blue; odd: is the first row that is read.

    On the sensor's even rows are blue and green, on the odd ones green and red.
    """
    same, other = (at, at + _LINE) if odd == 0 else (at + _LINE, at)
    outer = np.uint64(2 * _LANES) if odd == 0 else np.uint64(0)
    inner = np.uint64(0) if odd == 0 else np.uint64(2 * _LANES)
    down = np.uint64(5 * _LANES)
    half = np.float32(0.5)
    for i in range(length):
        k = np.uint64(i)
        a, b = same + k, other + k
        w0, w1, w2 = w[down + k], w[down + _LINE + k], w[down + _LINE + _LINE + k]
        w3 = w[down + _LINE + _LINE + _LINE + k]
        w4 = w[down + _LINE + _LINE + _LINE + _LINE + k]
        sums[outer + k] = (w2 * across[a] + w3 * across[a + step + step]
                           + w4 * across[a + step + step + step + step])
        sums[inner + k] = w0 * across[b + step] + w1 * across[b + step + step + step]
        sums[_LINE + k] = half * (w2 * across[b] + w3 * across[b + step + step]
                                  + w4 * across[b + step + step + step + step]
                                  + w0 * across[a + step] + w1 * across[a + step + step + step])


@compiled(inner=True)
def _write(sums, at, factors, scale, out, start, length):  # type: ignore[no-untyped-def]
    for i in range(length):
        k = np.uint64(i)
        out[start + k] = sums[at + k] * scale * factors[start + k]
