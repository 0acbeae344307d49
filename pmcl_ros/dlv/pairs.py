"""The stereo pairs of a light field: the centre view and each inner view that has light."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.light_field import ViewGrid
from pmcl_ros.runtime.errors import VolumeError

_ROUNDING = 1e-6  # px: a place so little outside is inside


@dataclass(frozen=True)
class StereoPairs:
    """Views that the centre view is compared with.

    grid: the views' geometry.
    indices: (pairs, 2) int64, row and column of each view in the grid.
    """

    grid: ViewGrid
    indices: NDArray[np.int64]

    @classmethod
    def from_grid(cls, grid: ViewGrid, views: int) -> 'StereoPairs':
        """The inner `views` x `views` of the grid (a smaller grid: all), without the centre.

        A view outside the pupil (weight 0) holds no picture and is left out: so is any view whose
        weight the caller sets to 0. Raises VolumeError when the centre view or every other view
        is dark.
        """
        if grid.weights[grid.centre] <= 0:
            raise VolumeError('the centre view has weight 0, as if outside the pupil: there is '
                              'nothing to match the others with; check the pupil weights, and '
                              'that its picture is not black')
        lit = inner_views(grid, views)
        lit[grid.centre] = False
        indices = np.argwhere(lit)
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
        """(pairs,) `gradient_share`, by where the views' light entered."""
        return gradient_share(self.positions)

    @property
    def light(self) -> NDArray[np.float64]:
        """(pairs,) information of a pair's difference, relative to two views of full light.

        A view of weight w was made 1 / w times as bright, and its photon noise with it: the
        variance of its difference from the centre view is (1 + 1 / w) / 2 times that of a view
        like the centre. Costs count by the inverse of that.
        """
        rows, columns = self.indices.T
        weights = (self.grid.weights[rows, columns] / self.grid.weights[self.grid.centre])
        return np.asarray(2 * weights / (1 + weights), float)

    def inside(self, depths: NDArray[np.floating]) -> NDArray[np.int64]:
        """(pairs, 4) first x, one past the last x, first y, one past the last y [px] of the pixels
        whose displaced places lie inside the pair's view at all `depths` [m].

        A pair counts for these pixels alone. Then every label of a pixel is judged by the same
        views, and none is punished because its samples leave the image.
        """
        shifts = self.shifts(depths)
        size = np.array([self.grid.pinhole.width, self.grid.pinhole.height])
        first = np.maximum(np.ceil(-shifts.min(axis=1) - _ROUNDING), 0)
        end = np.minimum(np.floor(size - 1 - shifts.max(axis=1) + _ROUNDING) + 1, size)
        return np.stack([first, end], axis=-1).reshape(-1, 4).astype(np.int64)

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
                f'out of their {pinhole.width}x{pinhole.height} px: choose a larger near, '
                'or is the baseline not in metres?')
        return shifts

    def labels_needed(self, near: float, far: float) -> int:
        """How many labels from `near` to `far` [m] it takes for no view to move by more than 1 px
        from one to the next: between coarser ones, matches and edges are missed.
        """
        first, last = self.shifts(np.array([far, near])).swapaxes(0, 1)
        return int(np.ceil(np.abs(last - first).max())) + 1


def inner_views(grid: ViewGrid, views: int) -> NDArray[np.bool_]:
    """(rows, columns) which of the inner `views` x `views` of a grid have light."""
    row, column = grid.centre
    rows, columns = np.ogrid[:grid.shape[0], :grid.shape[1]]
    return (np.maximum(abs(rows - row), abs(columns - column)) <= views // 2) & (grid.weights > 0)


def gradient_share(shifts: NDArray[np.float64]) -> NDArray[np.float64]:
    """(pairs,) the paper's gamma: the share of the x gradient in a pair's gradient cost.

    shifts: (pairs, 2) of its two views, along x and y, in any unit.
    """
    x, y = np.abs(shifts).T
    total = x + y
    return np.divide(x, total, out=np.full_like(total, 0.5), where=total > 0)


def cost_weights(gamma: NDArray[np.float64], beta: float) -> NDArray[np.float64]:
    """(pairs, 3) weights of the costs of colour, x gradient and y gradient (paper, section V.A).

    gamma: (pairs,) `gradient_share`. beta: share of the colour.
    """
    return np.stack([np.full_like(gamma, beta), (1 - beta) * gamma, (1 - beta) * (1 - gamma)],
                    axis=1)
