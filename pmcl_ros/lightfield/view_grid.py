"""The geometry of rectified views: a pinhole, a baseline, where each view's light entered."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import LightFieldError


@dataclass(frozen=True)
class ViewGrid:
    """A grid of rectified views: zero disparity at infinity.

    A point at (x, y, z) that the centre view sees at (u, v) is seen at
    (u - fx * baseline * a / z, v - fy * baseline * b / z) by a view whose centre of light lies at
    (a, b) view steps from the centre view's.

    baseline: metres between adjacent views.
    positions: (rows, columns, 2) float64, the (a, b) of each view; nominally (c - cc, r - rc).
    weights: (rows, columns) float32, the light each view got relative to the centre view; 0:
        outside the pupil, black.
    """

    pinhole: Pinhole
    baseline: float
    positions: NDArray[np.float64]
    weights: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.weights.ndim != 2 or self.positions.shape != (*self.weights.shape, 2):
            raise LightFieldError(f'positions {self.positions.shape} do not match weights '
                                  f'{self.weights.shape}; expected (rows, columns, 2) and '
                                  '(rows, columns)')
        if not (np.isfinite(self.positions).all() and np.isfinite(self.weights).all()
                and (self.weights >= 0).all()):
            raise LightFieldError(f'positions {self.positions.tolist()} and weights '
                                  f'{self.weights.tolist()} of views must be finite, and weights '
                                  'not negative')
        if not np.isfinite(self.baseline) or self.baseline <= 0:
            raise LightFieldError(f'baseline {self.baseline} m between views must be positive')

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of views."""
        rows, columns = self.weights.shape
        return rows, columns

    @property
    def centre(self) -> tuple[int, int]:
        """Row and column of the centre view."""
        return self.shape[0] // 2, self.shape[1] // 2


def nominal_positions(rows: int, columns: int) -> NDArray[np.float64]:
    """(rows, columns, 2) positions in view steps, one step apart, the centre view at (0, 0)."""
    b, a = np.mgrid[:rows, :columns].astype(float)
    return np.stack([a - columns // 2, b - rows // 2], axis=-1)
