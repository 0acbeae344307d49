"""The stereo pairs of a light field: the centre view and each inner view that has light."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.errors import VolumeError
from pmcl_ros.lightfield.geometry import ViewGrid


@dataclass(frozen=True)
class StereoPairs:
    """Views that the centre view is compared with.

    grid: the views' geometry.
    indices: (pairs, 2) int64, row and column of each view in the grid.
    """

    grid: ViewGrid
    indices: NDArray[np.int64]

    @classmethod
    def of(cls, grid: ViewGrid, views: int) -> 'StereoPairs':
        """The inner `views` x `views` of the grid (a smaller grid: all), without the centre.

        A view outside the pupil (weight 0) holds no picture and is left out. Any other counts
        fully, as in the paper, however little light it got: its brightness is restored when it is
        decoded. Raises VolumeError when the centre view or every other view is dark.
        """
        row, column = grid.centre
        if grid.weights[row, column] <= 0:
            raise VolumeError('the centre view has weight 0, as if outside the pupil: there is '
                              'nothing to match the others with; check the pupil weights')
        rows, columns = np.indices(grid.shape)
        inner = np.maximum(abs(rows - row), abs(columns - column)) <= views // 2
        inner[row, column] = False
        indices = np.argwhere(inner & (grid.weights > 0))
        if len(indices) == 0:
            raise VolumeError(
                f'of the inner {views}x{views} of {grid.shape[0]}x{grid.shape[1]} views only the '
                'centre has light (weight above 0): a depth likelihood needs two views or more')
        return cls(grid, indices)

    @property
    def positions(self) -> NDArray[np.float64]:
        """(pairs, 2) each view's centre of light, x and y in view steps from the centre view's."""
        rows, columns = self.indices.T
        return self.grid.positions[rows, columns]

    @property
    def gamma(self) -> NDArray[np.float64]:
        """(pairs,) the paper's gamma: the share of the x gradient in a view's gradient cost."""
        x, y = np.abs(self.positions).T
        total = x + y
        return np.divide(x, total, out=np.full_like(total, 0.5), where=total > 0)

    def shifts(self, depths: NDArray[np.floating]) -> NDArray[np.float64]:
        """(pairs, labels, 2) displacement in each view, x and y [px], of a point at `depths` [m].

        Raises VolumeError when a point leaves the image altogether: the depths are not this
        camera's.
        """
        pinhole = self.grid.pinhole
        step = -self.grid.baseline * np.array([pinhole.fx, pinhole.fy])
        shifts = self.positions[:, None, :] * step / np.asarray(depths, float)[:, None]
        if not (np.abs(shifts) < (pinhole.width, pinhole.height)).all():
            raise VolumeError(
                f'at {np.min(depths):g} m views are displaced by {np.abs(shifts).max():.0f} px, '
                f'out of their {pinhole.width}x{pinhole.height} px: choose a larger near')
        return shifts
