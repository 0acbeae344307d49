"""Runs of labels over which a view's bilinear samples change smoothly."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Runs:
    """Neighbouring labels whose displacement in a view lies in one cell of the pixel grid.

    where: (runs, 5) int64, the pair, its first label, one past the last, the cell's x and y [px].
    origin: (runs, 2) float32, the place in the cell at the first label, x and y [px].
    slope: (runs, 2) float32, how far the place moves from the first label to the last [px].
    time: (pairs, labels) float32, from 0 at the first label of a run to 1 at the last.
    """

    where: NDArray[np.int64]
    origin: NDArray[np.float32]
    slope: NDArray[np.float32]
    time: NDArray[np.float32]

    @classmethod
    def of(cls, shifts: NDArray[np.float64], depths: NDArray[np.float64]) -> 'Runs':
        """Split displacements (pairs, labels, 2) [px], linear in 1 / depths (labels,)."""
        pairs, labels = shifts.shape[:2]
        cells = np.floor(shifts).astype(np.int64)
        opens = np.ones((pairs, labels), bool)
        opens[:, 1:] = (np.diff(cells, axis=1) != 0).any(axis=2)
        pair, first = np.nonzero(opens)
        end = np.append(first[1:], 0)
        end[end == 0] = labels
        run = opens.cumsum().reshape(pairs, labels) - 1
        inverse = 1 / depths
        elapsed = inverse - inverse[first][run]
        whole = (inverse[end - 1] - inverse[first])[run]
        time = np.divide(elapsed, whole, out=np.zeros_like(elapsed), where=whole != 0)
        begin, cell = shifts[pair, first], cells[pair, first]
        slope = shifts[pair, end - 1] - begin
        return cls(np.column_stack([pair, first, end, cell]), (begin - cell).astype(np.float32),
                   slope.astype(np.float32), time.astype(np.float32))
