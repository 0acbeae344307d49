"""Where the frames of a sweep lie in the grid of views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.sweep.settings import SweepSettings


@dataclass(frozen=True)
class Layout:
    """Cells of a grid, and how far each frame is from its cell's middle.

    cells: (n, 2) int64 row and column of each frame; outside the grid where there is no such cell.
    aside: (n,) from the cell's middle, in view steps.
    away: (n,) from the middle of the centre cell, in view steps.
    """

    cells: NDArray[np.int64]
    aside: NDArray[np.float64]
    away: NDArray[np.float64]
    shape: tuple[int, int]

    @classmethod
    def of(cls, poses: Sequence[NDArray[np.float64]], settings: SweepSettings,
           middle: NDArray[np.float64] | None = None) -> 'Layout':
        """The layout of cameras at `poses` (n, 4, 4).

        middle: (4, 4) the grid's own pose, x along its rows, y along its columns; None: the
        direction that is nearest to all cameras', and the place where most cells have a frame.
        """
        cameras = np.array(poses, float).reshape(-1, 4, 4)
        shape = np.array([settings.rows, settings.columns])
        if middle is None:
            turn = _typical(cameras[:, :3, :3])
            steps = (cameras[:, :3, 3] @ turn)[:, 1::-1] / settings.baseline
            steps -= _corner(steps, (settings.rows, settings.columns))
        else:
            places = (cameras[:, :3, 3] - middle[:3, 3]) @ middle[:3, :3]
            steps = places[:, 1::-1] / settings.baseline + (shape - 1) / 2
        cells = np.floor(steps + 0.5).astype(np.int64)
        return cls(cells, np.linalg.norm(steps - cells, axis=1),
                   np.linalg.norm(steps - shape // 2, axis=1), (settings.rows, settings.columns))

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(n,) whether a frame lies in the grid."""
        return np.asarray(((self.cells >= 0) & (self.cells < self.shape)).all(axis=1))

    @property
    def filled(self) -> int:
        """How many cells have a frame."""
        return len(np.unique(self.cells[self.inside], axis=0))


def _typical(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) the one of the rotations (n, 3, 3) that the sum of angles to the others is least of.

    A mean would follow a frame that looks elsewhere.
    """
    cosines = (np.einsum('iab,jab->ij', turns, turns) - 1) / 2
    return np.asarray(turns[np.arccos(np.clip(cosines, -1, 1)).sum(axis=1).argmin()])


def _corner(steps: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.float64]:
    """(2,) where cell (0, 0) of a grid lies that has frames (n, 2) in most of its cells.

    Of such grids that whose frames are nearest to their cells. All are tried in which a frame is
    in the middle of a cell: a middle of all frames would follow one that is far out.
    """
    rows, columns = shape
    best, corner = -np.inf, steps[0]
    for own in steps:
        apart = steps - own
        cells = np.floor(apart + 0.5).astype(np.int64)
        near = (abs(cells) < shape).all(axis=1)
        aside = np.linalg.norm(apart - cells, axis=1)[near].mean()
        sums = np.zeros((2 * rows, 2 * columns), np.int64)
        places = cells[near] + shape
        sums[places[:, 0], places[:, 1]] = 1
        sums = sums.cumsum(axis=0).cumsum(axis=1)
        filled = (sums[rows:, columns:] - sums[:rows, columns:] - sums[rows:, :columns]
                  + sums[:rows, :columns])  # of the grid whose last cell is at (i, j)
        row, column = np.unravel_index(filled.argmax(), filled.shape)
        score = float(filled[row, column] - aside)
        if score > best:
            best, corner = score, own + np.array([row - rows + 1, column - columns + 1])
    return np.asarray(corner)
