"""The decode as toolboxes write it, in numpy and scipy: what the fast form is timed against."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve, map_coordinates

from pmcl_ros.lightfield.calibration.calibration import Calibration
from pmcl_ros.lightfield.light_field import ViewGrid

_DARKEST = 0.05
_CROSS = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]], np.float32) / 4
_SQUARE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]], np.float32) / 4


def plain_decode(data: bytes, black: float, white: float, light: NDArray[np.float32],
                 calibration: Calibration, grid: ViewGrid) -> NDArray[np.float32]:
    """Views (rows, columns, height, width, 3) of a packed picture.

    Unpacked; divided by the white image; demosaiced linearly, across the lenslets' borders; read
    at an offset from every lenslet's centre; interpolated along the lattice's rows, then across.
    """
    height, width = light.shape
    linear = (_unpack(data, width, height) - np.float32(black)) * np.float32(1 / (white - black))
    colours = _demosaic(linear / np.maximum(light, np.float32(_DARKEST)))
    lattice = calibration.lattice
    i0, i1, j0, j1 = lattice.index_range(width, height)
    i0, i1, j0, j1 = i0 - 8, i1 + 8, j0 - 8, j1 + 8
    x, y = np.moveaxis(lattice.centres(*np.meshgrid(np.arange(i0, i1), np.arange(j0, j1))), -1, 0)
    pinhole, pitch = grid.pinhole, width / grid.pinhole.width
    focus = calibration.baseline / calibration.focus_distance
    cos, sin = np.cos(lattice.rotation), np.sin(lattice.rotation)
    v, u = np.indices((pinhole.height, pinhole.width), np.float64)
    views = np.zeros((*grid.shape, pinhole.height, pinhole.width, 3), np.float32)
    for row, column in np.argwhere(grid.weights > 0):
        a, b = column - grid.centre[1], row - grid.centre[0]
        samples = [map_coordinates(each, [y + b, x + a], order=1, mode='nearest')
                   for each in colours]
        shift_x, shift_y = grid.positions[row, column] * [pinhole.fx * focus, pinhole.fy * focus]
        raw_x = (u + shift_x + 0.5) * pitch - 0.5 - lattice.centre_px[0]
        raw_y = (v + shift_y + 0.5) * pitch - 0.5 - lattice.centre_px[1]
        across = (cos * raw_y - sin * raw_x) / lattice.row_step_px
        along = (cos * raw_x + sin * raw_y) / lattice.pitch_px
        upper = np.floor(across)
        part = (across - upper).astype(np.float32)
        for colour, each in enumerate(samples):
            first, second = (map_coordinates(each, [j - j0, along - j % 2 / 2 - i0], order=1)
                             for j in (upper, upper + 1))
            views[row, column, :, :, colour] = (1 - part) * first + part * second
    return views


def _unpack(data: bytes, width: int, height: int) -> NDArray[np.uint16]:
    first, second, third = np.frombuffer(data, np.uint8).reshape(-1, 3).astype(np.uint16).T
    counts = np.stack([first << 4 | second >> 4, (second & 15) << 8 | third], axis=1)
    return counts.reshape(height, width)


def _demosaic(mosaic: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """Red, green and blue (height, width) of BGGR."""
    planes = [np.zeros_like(mosaic) for _ in range(3)]
    planes[0][1::2, 1::2] = mosaic[1::2, 1::2]
    planes[1][::2, 1::2], planes[1][1::2, ::2] = mosaic[::2, 1::2], mosaic[1::2, ::2]
    planes[2][::2, ::2] = mosaic[::2, ::2]
    return [convolve(plane, kernel, mode='nearest')
            for plane, kernel in zip(planes, (_SQUARE, _CROSS, _SQUARE), strict=True)]
