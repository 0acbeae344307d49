"""A grid of picture files of known geometry, read as rectified views."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid
from pmcl_ros.lightfield.readers.pictures import Reduction, linear_light, read_picture, shifted
from pmcl_ros.runtime.errors import LightFieldError

_NEAREST = 1e-4  # m


@dataclass(frozen=True)
class ViewFiles:
    """Picture files of a grid of parallel views.

    paths: [row][column].
    positions: (rows, columns, 2) [m] where each view was taken: x to the right, y down, from
        anywhere in the plane of the views.
    fx, fy, cx, cy: of the centre view [px], that of row rows // 2, column columns // 2 counted
        from the upper left of the plane; cx, cy None: the middle of the picture.
    focus_distance: depth of zero disparity [m]; infinity: the views are rectified already.
    gamma: the exponent that makes the files' values linear light; 1: they are.
    bits: of a value in 16-bit pictures.
    """

    paths: list[list[Path]]
    positions: NDArray[np.float64]
    fx: float
    fy: float
    cx: float | None = None
    cy: float | None = None
    focus_distance: float = math.inf
    gamma: float = 2.2
    bits: int = 16

    def read(self, header: Header, reduction: Reduction) -> LightField:
        """The light field, row and column growing with y and x, whatever the files' order.

        Raises LightFieldError when a file is missing or no picture, sizes differ, the positions
        are no grid, or the views do not fit the memory.
        """
        if self.focus_distance < _NEAREST:
            raise LightFieldError(f'a focus distance of {self.focus_distance:g} m is none of a '
                                  'camera')
        paths, positions = _ordered(self.paths, self.positions)
        rows, columns = (reduction.kept(side) for side in positions.shape[:2])
        positions = positions[np.ix_(rows, columns)]
        chosen = [[paths[row][column] for column in columns] for row in rows]
        centre = len(rows) // 2, len(columns) // 2
        height, width = read_picture(chosen[centre[0]][centre[1]], self.bits).shape[:2]
        reduction.check_memory(len(rows), len(columns), height, width)
        pinhole = reduction.pinhole(Pinhole(
            width, height, self.fx, self.fy, (width - 1) / 2 if self.cx is None else self.cx,
            (height - 1) / 2 if self.cy is None else self.cy))
        positions = positions - positions[centre]
        baseline = _baseline(positions)
        # All views show points at the focus distance at one place. A rectified view at lateral
        # position p is therefore read at f p / focus distance from there.
        shifts = positions * [pinhole.fx, pinhole.fy] / self.focus_distance
        if not (abs(shifts) < (pinhole.width, pinhole.height)).all():
            raise LightFieldError(
                f'to rectify the views they must be shifted by up to {abs(shifts).max():.0f} px, '
                f'out of their {pinhole.width}x{pinhole.height} px; check the focus distance '
                f'({self.focus_distance:g} m) and the baseline ({baseline:g} m)')
        views = np.empty((len(rows), len(columns), pinhole.height, pinhole.width, 3), np.float32)
        for row, column in np.ndindex(len(rows), len(columns)):
            path = chosen[row][column]
            picture = read_picture(path, self.bits)
            if picture.shape[:2] != (height, width):
                raise LightFieldError(
                    f'{path} has {picture.shape[1]}x{picture.shape[0]} pixels, the centre view '
                    f'{width}x{height}; all views must be of one size')
            linear = reduction.shrunk(linear_light(picture, self.gamma))
            shift_x, shift_y = shifts[row, column]
            views[row, column] = shifted(linear, float(shift_x), float(shift_y))
        # A black view was outside the pupil.
        weights = np.asarray(views.any(axis=(2, 3, 4)), np.float32)
        grid = ViewGrid(pinhole, baseline, positions / baseline, weights)
        return LightField(header, views, grid, 1 / self.gamma)


def _ordered(paths: list[list[Path]], positions: NDArray[np.float64]
             ) -> tuple[list[list[Path]], NDArray[np.float64]]:
    """Rows by growing y and columns by growing x; LightFieldError where that is no order."""
    positions = np.asarray(positions, float)
    across, down = np.diff(positions[..., 0], axis=1), np.diff(positions[..., 1], axis=0)
    if across.sum() < 0:
        paths, positions = [row[::-1] for row in paths], positions[:, ::-1]
    if down.sum() < 0:
        paths, positions = paths[::-1], positions[::-1]
    across, down = np.diff(positions[..., 0], axis=1), np.diff(positions[..., 1], axis=0)
    if not (np.isfinite(positions).all() and (across > 0).all() and (down > 0).all()):
        raise LightFieldError(
            'the positions of the views are no grid: x must grow along every row, or shrink along '
            f'every row, and so must y along columns; got {np.round(positions, 6).tolist()} m')
    return paths, positions


def _baseline(positions: NDArray[np.float64]) -> float:
    """Mean distance between views of neighbouring columns, or rows where there is one column."""
    rows, columns = positions.shape[:2]
    if rows * columns < 2:
        raise LightFieldError('one view alone is no light field; give two or more')
    if columns > 1:
        return float(np.diff(positions[..., 0], axis=1).mean())
    return float(np.diff(positions[..., 1], axis=0).mean())


