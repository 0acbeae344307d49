"""The second of the four values: the decoded, rectified views of one capture."""

from dataclasses import dataclass

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.colour import NEUTRAL, Colour
from pmcl_ros.lightfield.view_grid import ViewGrid
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.runtime.kernels import LOCK, compiled

_TASK = 2 ** 18  # values that one task checks


@dataclass(frozen=True)
class LightField:
    """Views of one capture.

    views: (rows, columns, height, width, 3) float32, linear RGB of the camera itself, 1 at the
        sensor's white; row and column index grow with the aperture's +y and +x; views of weight 0
        are black.
    gamma: exponent that makes linear values displayable (the camera's metadata; 1/2.4 for an F01).
    colour: what makes the camera's RGB that of a screen.
    Raises LightFieldError when the views are of another shape or not all finite numbers.
    """

    header: Header
    views: NDArray[np.float32]
    grid: ViewGrid
    gamma: float = 1 / 2.4
    colour: Colour = NEUTRAL

    def __post_init__(self) -> None:
        pinhole = self.grid.pinhole
        expected = (*self.grid.shape, pinhole.height, pinhole.width, 3)
        if self.views.shape != expected:
            raise LightFieldError(f'views have shape {self.views.shape}, the grid says {expected}')
        # One NaN spreads over all of an edge volume.
        if not _is_finite(self.views):
            raise LightFieldError('views hold NaN or infinity; every value must be finite, and 0 '
                                  'where there is no light')
        if not 0 < self.gamma < np.inf:
            raise LightFieldError(f'gamma {self.gamma} must be positive')

    @property
    def centre_view(self) -> NDArray[np.float32]:
        """(height, width, 3), linear."""
        return self.views[self.grid.centre]

    def picture(self) -> NDArray[np.uint8]:
        """The centre view to look at: (height, width, 3) uint8 RGB, as a screen shows it."""
        return self.colour.displayed(self.centre_view, self.gamma)


def _is_finite(views: NDArray[np.floating]) -> bool:
    if views.dtype != np.float32 or not views.flags.c_contiguous:
        return bool(np.isfinite(views).all())
    with LOCK:
        return bool(_zeros_of(views.reshape(-1)) == 0)


@compiled(parallel=True)
def _zeros_of(values):  # type: ignore[no-untyped-def]
    """The sum of values times zero: NaN if one of them is NaN or infinite."""
    total = np.float32(0)
    for task in prange(-(-len(values) // _TASK)):
        first, part = np.uint64(task * _TASK), np.float32(0)
        for k in range(min(_TASK, len(values) - task * _TASK)):
            part += values[first + np.uint64(k)] * np.float32(0)
        total += part
    return total
