"""What the pictures of a board measured."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.calibration.bend import Sheet
from pmcl_ros.lightfield.calibration.lytro.corners import Corners


@dataclass(frozen=True)
class Observations:
    """n pictures of a board with m corners.

    points: (m, 3) on the board, metres, z = 0: while it is flat.
    values: (n, m, 4) position and disparity of every corner, as in `Corners`.
    whitening: (n, m, 4, 4) W with W^T W = the inverse of the covariance; 0: not measured.
    """

    points: NDArray[np.float64]
    values: NDArray[np.float64]
    whitening: NDArray[np.float64]

    @classmethod
    def from_corners(cls, boards: Sequence[Corners], square: float) -> 'Observations':
        """square: side of the board's squares [m]."""
        rows, columns = boards[0].valid.shape
        y, x = np.mgrid[:rows, :columns] * square
        points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
        values, whitening = [], []
        for board in boards:
            values.append(np.concatenate([board.positions, board.disparities], axis=-1)
                          .reshape(-1, 4))
            valid = board.valid.reshape(-1)
            covariances = np.where(valid[:, None, None], board.covariances.reshape(-1, 4, 4),
                                   np.eye(4))
            roots = np.linalg.inv(np.linalg.cholesky(covariances))
            whitening.append(roots * valid[:, None, None])
        return cls(points, np.stack(values), np.stack(whitening))

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n, m) which corners were measured."""
        return np.asarray(self.whitening.any(axis=(-1, -2)))

    @cached_property
    def sheet(self) -> Sheet:
        """The board's, which is the same in all pictures."""
        return Sheet(self.points)

    def excluding(self, dropped: NDArray[np.bool_]) -> 'Observations':
        """Without some corners (n, m)."""
        return replace(self, whitening=self.whitening * ~dropped[..., None, None])
