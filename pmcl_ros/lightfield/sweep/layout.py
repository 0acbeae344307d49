"""Where the frames of a sweep lie in the grid of views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

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

        middle: (4, 4) the grid's own pose, x along its rows, y along its columns; None: the mean
        direction of all cameras, in the middle of the box about them.
        """
        cameras = np.array(poses, float).reshape(-1, 4, 4)
        shape = np.array([settings.rows, settings.columns])
        if middle is None:
            turn = Rotation.from_matrix(cameras[:, :3, :3]).mean().as_matrix()
            places = cameras[:, :3, 3] @ turn
            places -= (places.min(axis=0) + places.max(axis=0)) / 2
        else:
            places = (cameras[:, :3, 3] - middle[:3, 3]) @ middle[:3, :3]
        steps = places[:, 1::-1] / settings.baseline + (shape - 1) / 2  # rows, columns
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
