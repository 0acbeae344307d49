"""The geometry of rectified views: a pinhole, a baseline, where each view's light entered."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.errors import LightFieldError


@dataclass(frozen=True)
class Pinhole:
    """The centre view's pinhole, in pixels; pixel centres at integers, 0-based.

    A point (x, y, z) in the optical frame [m] is seen at (fx x / z + cx, fy y / z + cy).
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        finite = np.isfinite([self.fx, self.fy, self.cx, self.cy]).all()
        if not finite or self.width < 1 or self.height < 1 or self.fx <= 0 or self.fy <= 0:
            raise LightFieldError(
                f'impossible camera {self}: sizes and focal lengths must be positive')

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The 3x3 camera matrix K."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def project(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Pixels (..., 2) of points (..., 3) in the optical frame [m]; NaN behind the camera."""
        points = np.asarray(points, float)
        z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        return np.stack([self.fx * points[..., 0] / z + self.cx,
                         self.fy * points[..., 1] / z + self.cy], axis=-1)

    def crop(self, left: int, top: int, width: int, height: int) -> 'Pinhole':
        """The same camera seen through a window of its image."""
        return replace(self, width=width, height=height, cx=self.cx - left, cy=self.cy - top)

    def resized(self, width: int, height: int) -> 'Pinhole':
        """The same camera with other pixels: the same field of view in width x height."""
        across, down = width / self.width, height / self.height
        return Pinhole(width, height, self.fx * across, self.fy * down,
                       (self.cx + 0.5) * across - 0.5, (self.cy + 0.5) * down - 0.5)

    def subsample(self, step: int) -> 'Pinhole':
        """The camera of every `step`-th pixel of each axis, the first included."""
        return Pinhole(-(-self.width // step), -(-self.height // step), self.fx / step,
                       self.fy / step, self.cx / step, self.cy / step)


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
