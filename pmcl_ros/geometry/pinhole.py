"""An ideal camera without distortion."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import LightFieldError


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

    @property
    def off_middle(self) -> float:
        """How far the principal point is from the picture's middle, in shares of its side.

        The larger of both axes; more than 0.5: it is outside of the picture.
        """
        return max(abs(self.cx - (self.width - 1) / 2) / self.width,
                   abs(self.cy - (self.height - 1) / 2) / self.height)

    def project(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Pixels (..., 2) of points (..., 3) in the optical frame [m]; NaN behind the camera."""
        points = np.asarray(points, float)
        z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        return np.stack([self.fx * points[..., 0] / z + self.cx,
                         self.fy * points[..., 1] / z + self.cy], axis=-1)

    def rays(self, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
        """(..., 3) the points at depth 1 in the optical frame that pixels (..., 2) show."""
        x, y = np.moveaxis(pixels, -1, 0)
        return np.stack([(x - self.cx) / self.fx, (y - self.cy) / self.fy, np.ones_like(x)],
                        axis=-1)

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
