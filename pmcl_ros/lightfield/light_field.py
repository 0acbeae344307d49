"""The second of the four values: the decoded, rectified views of one capture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.errors import LightFieldError
from pmcl_ros.header import Header
from pmcl_ros.lightfield.geometry import ViewGrid


@dataclass(frozen=True)
class LightField:
    """Views of one capture.

    views: (rows, columns, height, width, 3) float32, linear RGB, 1 at the sensor's white; row and
        column index grow with the aperture's +y and +x; views of weight 0 are black.
    gamma: exponent that makes linear values displayable (the camera's metadata; 1/2.4 for an F01).
    Raises LightFieldError when the views are of another shape or not all finite numbers.
    """

    header: Header
    views: NDArray[np.float32]
    grid: ViewGrid
    gamma: float = 1 / 2.4

    def __post_init__(self) -> None:
        pinhole = self.grid.pinhole
        expected = (*self.grid.shape, pinhole.height, pinhole.width, 3)
        if self.views.shape != expected:
            raise LightFieldError(f'views have shape {self.views.shape}, the grid says {expected}')
        # One NaN spreads over all of an edge volume.
        if not np.isfinite(self.views).all():
            raise LightFieldError('views hold NaN or infinity; every value must be finite, and 0 '
                                  'where there is no light')
        if not 0 < self.gamma < np.inf:
            raise LightFieldError(f'gamma {self.gamma} must be positive')

    @property
    def centre_view(self) -> NDArray[np.float32]:
        """(height, width, 3), linear."""
        return self.views[self.grid.centre]

    def picture(self) -> NDArray[np.uint8]:
        """The centre view to look at: (height, width, 3) uint8 RGB, gamma applied."""
        return np.round(255 * np.clip(self.centre_view, 0, 1) ** self.gamma).astype(np.uint8)
