"""From the hexagonal lattice of lenslets to square views, by the triangle of the nearest three."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.lenslets import Lenslets
from pmcl_ros.lightfield.light_field import VIEW_MOST, VIEW_WHITE
from pmcl_ros.runtime.kernels import compiled, rounds


@dataclass(frozen=True)
class ViewPixels:
    """Maps pixels of a rectified view to places on the sensor.

    pinhole: of the views.
    scale: raw px that a view pixel is wide, and high: pixel (x, y) covers the sensor's
        scale * (x .. x + 1, y .. y + 1).
    k1, k2: radial distortion, in the pinhole's normalised coordinates.
    """

    pinhole: Pinhole
    scale: tuple[float, float]
    k1: float = 0.0
    k2: float = 0.0

    def places(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.float64]:
        """(..., 2) raw px of places in a lattice-aligned view without distortion [view px]."""
        pinhole = self.pinhole
        across, along = (x - pinhole.cx) / pinhole.fx, (y - pinhole.cy) / pinhole.fy
        square = across ** 2 + along ** 2
        stretch = 1 + square * (self.k1 + square * self.k2)
        return np.stack([
            (pinhole.cx + (x - pinhole.cx) * stretch + 0.5) * self.scale[0] - 0.5,
            (pinhole.cy + (y - pinhole.cy) * stretch + 0.5) * self.scale[1] - 0.5], axis=-1)

    def reach(self, shifts: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n, 4) first and last raw column and row that views read at their `shifts` (n, 2)."""
        x, y = np.arange(self.pinhole.width), np.arange(self.pinhole.height)
        top, left = np.zeros(len(x)), np.zeros(len(y))
        x, y = (np.concatenate([x, x, left, left + x[-1]]),
                np.concatenate([top, top + y[-1], y, y]))
        places = self.places(x + shifts[:, :1], y + shifts[:, 1:])
        low, high = places.min(axis=1), places.max(axis=1)
        return np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=-1)


@dataclass(frozen=True)
class StandIns:
    """Replacements of the samples that views need from beyond the sensor's edge.

    lenslets: (m, 4) int64, row and column of a lenslet whose sample lies off the sensor, then of
        the one nearest to it whose sample does not; view after view.
    starts: (n + 1,) index of each view's first row in `lenslets`.
    """

    lenslets: NDArray[np.int64]
    starts: NDArray[np.int64]

    @classmethod
    def find(cls, block: Lenslets, lattice: Lattice, offsets: NDArray[np.integer],
           reach: NDArray[np.floating], width: int, height: int) -> 'StandIns':
        """The stand-ins for samples at offsets (n, 2) [raw px] from the centres of a block.

        reach: (n, 4) of `ViewPixels.reach`. width, height: of the sensor [raw px].
        """
        last = np.array([width - 1, height - 1])
        inset = np.minimum(1.2 * block.radius, last / 2)  # beyond it the nearest is on the sensor
        near = 2 * lattice.pitch_px  # the corners of a cell lie so near to the places in it
        found = []
        for offset, (left, right, top, bottom) in zip(offsets, reach, strict=True):
            x, y = np.moveaxis(block.centres, -1, 0)
            read = (x > left - near) & (x < right + near) & (y > top - near) & (y < bottom + near)
            places = block.centres + offset
            off = read & ((places < 0) | (places > last)).any(axis=-1)
            inside = np.clip(places[off], inset, last - inset) - offset
            found.append(np.column_stack([*np.nonzero(off), block.nearest(lattice, inside)]))
        starts = np.cumsum([0, *map(len, found)])
        return cls(np.concatenate(found).astype(np.int64), starts)


def resample_views(samples: NDArray[np.float32], lattice: Lattice, origin: tuple[int, int],
                   pixels: ViewPixels, shifts: NDArray[np.float64], stand_ins: StandIns,
                   slots: NDArray[np.int64], out: NDArray[np.float32]) -> None:
    """Views on the pixel grid, interpolated linearly in the triangle of lenslets around a pixel.

    samples: (rows, n, 3, columns) of lenslets (j, i) = origin + (row, column), all that are read;
        those off the sensor are filled.
    shifts: (n, 2) view px: view n is read at (x, y) + shifts[n], which rectifies it.
    slots: (n,) the places in `out` of the views.
    out: (m, height, width, 3) float32; the views outside `slots` are filled with 0. Values are
        whole counts over VIEW_WHITE: messages, bags and files bring them back bit for bit, so
        that poses do not depend on the transport.
    """
    cx, cy = lattice.centre_px
    pinhole = pixels.pinhole
    which = np.full(len(out), -1)
    which[slots] = np.arange(len(slots))
    grid = np.array([lattice.pitch_px, lattice.row_step_px, math.cos(lattice.rotation),
                     math.sin(lattice.rotation), cx, cy])
    lens = np.array([pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy, *pixels.scale,
                     pixels.k1, pixels.k2])
    _resample(samples.reshape(-1), samples.shape[1], samples.shape[3], grid, origin[0],
              origin[1], lens, shifts,
              stand_ins.lenslets, stand_ins.starts, which, out)


@compiled(parallel=True)
def _resample(samples, views, columns, grid, j0, i0, lens,  # type: ignore[no-untyped-def]
              shifts, stand_ins, starts, which, out, portion):
    count, height, width = out.shape[:3]
    flat = out.reshape(-1)
    for slot in rounds(count, portion):
        first, size = np.uint64(slot * height * width * 3), height * width * 3
        view = which[slot]
        if view < 0:
            for k in range(size):
                flat[first + np.uint64(k)] = 0
            continue
        for k in range(starts[view], starts[view + 1]):
            to = (stand_ins[k, 0] * views + view) * 3 * columns + stand_ins[k, 1]
            source = (stand_ins[k, 2] * views + view) * 3 * columns + stand_ins[k, 3]
            for colour in range(3):
                samples[to + colour * columns] = samples[source + colour * columns]
        part = np.empty((2, width), np.float32)
        line = np.empty((3, width), np.float32)
        cell = np.empty((2, width), np.int64)
        for y in range(height):
            _locate(grid, lens, y + shifts[view, 1], shifts[view, 0], columns * 3 * views, part,
                    cell)
            start = 0
            while start < width:
                end = start + 1
                while end < width and cell[0, end] == cell[0, start]:
                    end += 1
                j, i = cell[1, start], cell[0, start] - cell[1, start] * columns * 3 * views
                upper = ((j - j0) * views + view) * 3 * columns + i + start - i0
                lower = upper + views * 3 * columns + j % 2
                for colour in range(3):
                    _blend(samples, np.uint64(upper + colour * columns),
                           np.uint64(lower + colour * columns), part, line,
                           np.uint64(colour), np.uint64(start),
                           end - start)
                start = end
            _interleave(line, flat, np.uint64((slot * height + y) * width * 3))


@compiled(inner=True)
def _locate(grid, lens, y, shift, stride, part, cell):  # type: ignore[no-untyped-def]
    """The cell of lenslets that each pixel of a row lies in, and its place (p, t) in the cell.

    Odd rows of the lattice are moved by half a pitch. In coordinates skewed by that half step the
    lenslets form unit squares, the cells. Along a run of pixels of one key every corner of the
    cell moves on by one lenslet.
    """
    pitch, row_step, cos, sin, cx, cy = grid
    fx, fy, px, py, wide, high, k1, k2 = lens
    for x in range(part.shape[1]):
        dx, dy = x + shift - px, y - py
        u, v = dx / fx, dy / fy
        square = u * u + v * v
        stretch = 1 + square * (k1 + square * k2)
        raw_x = (px + dx * stretch + 0.5) * wide - 0.5 - cx
        raw_y = (py + dy * stretch + 0.5) * high - 0.5 - cy
        across = (cos * raw_y - sin * raw_x) / row_step
        row = math.floor(across)
        t = across - row
        skewed = (cos * raw_x + sin * raw_y) / pitch - 0.5 * ((row & 1) + t)
        column = math.floor(skewed)
        part[0, x] = skewed - column
        part[1, x] = t
        cell[0, x] = row * stride + column - x
        cell[1, x] = row


@compiled(inner=True)
def _blend(samples, upper, lower, part, line, colour, start, length):  # type: ignore[no-untyped-def]
    """One colour of a run: the diagonal p + t = 1 cuts each cell into the lattice's triangles.

    Values are rounded to whole counts of a `views` message.
    """
    one, zero, half = np.float32(1), np.float32(0), np.float32(0.5)
    white, most = np.float32(VIEW_WHITE), np.float32(VIEW_MOST)
    for m in range(length):
        k = np.uint64(m)
        p, t = part[0, start + k], part[1, start + k]
        both = p + t - one
        last = both if both > zero else zero
        value = ((last - both) * samples[upper + k]
                 + (p - last) * samples[upper + k + np.uint64(1)]
                 + (t - last) * samples[lower + k]
                 + last * samples[lower + k + np.uint64(1)])
        count = min(max(value * white + half, zero), most)
        line[colour, start + k] = np.float32(np.int32(count)) / white


@compiled(inner=True)
def _interleave(line, flat, at):  # type: ignore[no-untyped-def]
    for m in range(line.shape[1]):
        k = at + np.uint64(3 * m)
        flat[k] = line[0, m]
        flat[k + np.uint64(1)] = line[1, m]
        flat[k + np.uint64(2)] = line[2, m]
