"""Segments of labels over which the samples of a view are quadratics in the label."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.sampling import bilinear_taps, neutral_taps

_REACH = 1.0  # px: of a noise-neutral run; its three nodes are then half a pixel apart at most


@dataclass(frozen=True)
class LabelSegments:
    """Neighbouring labels of a pair, and three nodes through which its samples' quadratics go.

    where: (runs, 4) int64, the pair, its first label, one past the last, the first of the run's
        three nodes; the last node of a run may be the first of the next.
    places: (nodes, 2) displacement of a node, x and y [px].
    cells: (nodes, 2) int64, the pixel that lies left of it and above, or at it [px].
    taps: (nodes, 2, 4) float32, weights along x and y of the pixels at -1, 0, 1, 2 from the cell.
    time: (pairs, labels) float32, 0 at a run's first node, 1 at its last.
    """

    where: NDArray[np.int64]
    places: NDArray[np.float64]
    cells: NDArray[np.int64]
    taps: NDArray[np.float32]
    time: NDArray[np.float32]

    @classmethod
    def bilinear(cls, shifts: NDArray[np.float64]) -> 'LabelSegments':
        """Segments that stay in a cell of the pixel grid, where bilinear samples *are* quadratics.

        shifts: (pairs, labels, 2) displacements [px], each pair's on a line.
        """
        pairs, labels = shifts.shape[:2]
        cells = np.floor(shifts).astype(np.int64)
        opens = np.ones((pairs, labels), bool)
        opens[:, 1:] = (np.diff(cells, axis=1) != 0).any(axis=2)
        pair, first = np.nonzero(opens)
        end = np.append(first[1:], 0)
        end[end == 0] = labels
        start, last = shifts[pair, first], shifts[pair, end - 1]
        nodes = np.stack([start, (start + last) / 2, last], axis=1)
        cell = cells[pair, first]
        run = opens.cumsum().reshape(pairs, labels) - 1
        time = _along(shifts, start[run], last[run])
        where = np.column_stack([pair, first, end, 3 * np.arange(len(pair))])
        taps = bilinear_taps(nodes - cell[:, None])
        return cls(where, nodes.reshape(-1, 2), np.repeat(cell, 3, axis=0),
                   taps.reshape(-1, 2, 4).astype(np.float32),
                   time.astype(np.float32))

    @classmethod
    def neutral(cls, shifts: NDArray[np.float64]) -> 'LabelSegments':
        """Segments of at most a pixel: between nodes half a pixel apart noise keeps its power too.

        The nodes are exact noise-neutral samples; a quadratic through them is within 1.5 % of the
        power of any noise that the pixel grid holds. shifts: as for `bilinear`.
        """
        start, last = shifts[:, 0], shifts[:, -1]
        counts = np.maximum(np.ceil(np.linalg.norm(last - start, axis=1) / _REACH), 1).astype(int)
        part = _along(shifts, start[:, None], last[:, None]) * counts[:, None]
        run = np.minimum(part.astype(int), counts[:, None] - 1)
        opens = np.ones(run.shape, bool)
        opens[:, 1:] = np.diff(run, axis=1) != 0
        pair, first = np.nonzero(opens)
        end = np.append(first[1:], 0)
        end[end == 0] = run.shape[1]
        base = np.cumsum(2 * counts + 1) - (2 * counts + 1)
        where = np.column_stack([pair, first, end, base[pair] + 2 * run[pair, first]])
        nodes = np.concatenate([np.linspace(a, b, 2 * count + 1)
                                for a, b, count in zip(start, last, counts, strict=True)])
        cells = np.floor(nodes).astype(np.int64)
        taps = neutral_taps(nodes - cells).astype(np.float32)
        return cls(where, nodes, cells, taps, (part - run).astype(np.float32))


def _along(places: NDArray[np.float64], start: NDArray[np.float64], last: NDArray[np.float64]
           ) -> NDArray[np.float64]:
    """(...) how far `places` (..., 2) are on the way from `start` to `last`, 0 to 1."""
    way = last - start
    length = (way ** 2).sum(axis=-1)
    return np.divide(((places - start) * way).sum(axis=-1), length,
                     out=np.zeros(np.broadcast_shapes(places.shape, way.shape)[:-1]),
                     where=np.broadcast_to(length > 0, places.shape[:-1]))
