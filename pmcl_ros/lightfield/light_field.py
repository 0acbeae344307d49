"""LightField: the rectified views of one capture, their geometry, and their integer encoding."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.colour import NEUTRAL, Colour
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.runtime.kernels import compiled, rounds

_TASK = 2 ** 18  # values that one task checks
_GREATEST = np.finfo(np.float32).max
VIEW_WHITE = 32768  # count at the sensor's white: room for twice that, then clipped
VIEW_MOST = 65535  # count that is clipped: of 16 bits


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

    @classmethod
    def of_one_view(cls, pinhole: Pinhole, baseline: float = 1.0) -> 'ViewGrid':
        """Of an ordinary camera, which has no other view that a baseline [m] leads to."""
        return cls(pinhole, baseline, nominal_positions(1, 1), np.ones((1, 1), np.float32))

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


@dataclass(frozen=True)
class LightField:
    """Rectified views of one capture, in linear colours.

    views: (rows, columns, height, width, 3) float32, linear RGB of the camera itself, 1 at the
        sensor's white; row and column index grow with the aperture's +y and +x; views of weight 0
        are black.
    gamma: exponent that makes linear values displayable (the camera's metadata; 1/2.4 for an F01).
    colour: converts the RGB of the camera to that of a screen.
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
        # One NaN would spread over all of an edge volume.
        if not _is_finite(self.views):
            raise LightFieldError('views hold NaN or infinity; every value must be finite, and 0 '
                                  'where there is no light')
        if not 0 < self.gamma < np.inf:
            raise LightFieldError(f'gamma {self.gamma} must be positive')

    @classmethod
    def of_one_view(cls, header: Header, picture: NDArray[np.float32], pinhole: Pinhole
                    ) -> 'LightField':
        """Of an ordinary picture (height, width, 3), linear."""
        return cls(header, picture[None, None], ViewGrid.of_one_view(pinhole))

    @property
    def pinhole(self) -> Pinhole:
        """Of each view."""
        return self.grid.pinhole

    @property
    def centre_view(self) -> NDArray[np.float32]:
        """(height, width, 3), linear."""
        return self.views[self.grid.centre]

    def picture(self) -> NDArray[np.uint8]:
        """The centre view for a screen: (height, width, 3) uint8 RGB."""
        return self.colour.displayed(self.centre_view, self.gamma)


def _is_finite(views: NDArray[np.floating]) -> bool:
    if views.dtype != np.float32 or not views.flags.c_contiguous:
        return bool(np.isfinite(views).all())
    return sum(_count_of_bad(views.reshape(-1))) == 0


@compiled(parallel=True)
def _count_of_bad(values, portion):  # type: ignore[no-untyped-def]
    """The number of values that are NaN or infinite."""
    total = 0
    for task in rounds(-(-len(values) // _TASK), portion):
        first, part = np.uint64(task * _TASK), np.int32(0)
        for k in range(min(_TASK, len(values) - task * _TASK)):
            # A sum of zero times the values may overflow: compilers may multiply the sum.
            part += np.int32(not abs(values[first + np.uint64(k)]) <= _GREATEST)
        total += part
    return total


def views_of_mosaic(mosaic: NDArray[np.uint16], rows: int, columns: int) -> NDArray[np.float32]:
    """(rows, columns, height, width, 3) linear views of a mosaic (rows height, columns width, 3).

    Its counts are VIEW_WHITE at 1.
    """
    height, width = mosaic.shape[0] // rows, mosaic.shape[1] // columns
    lines = np.ascontiguousarray(mosaic).reshape(-1, width * 3)
    order = np.arange(len(lines)).reshape(rows, height, columns).transpose(0, 2, 1).ravel()
    linear = np.empty(lines.shape, np.float32)
    _scale(lines, order, np.float32(1 / VIEW_WHITE), linear)
    return linear.reshape(rows, columns, height, width, 3)


@compiled(parallel=True)
def _scale(lines, order, factor, out, portion):  # type: ignore[no-untyped-def]
    for number in rounds(len(order), portion):
        source, scaled = lines[order[number]], out[number]
        for k in range(len(source)):
            scaled[k] = np.float32(source[k]) * factor
