"""A checkerboard in the views of a light field."""

import math
from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.lytro.corners import Corners
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import LightFieldError

# Disparities of lattice-aligned views [px per step] at which a board may be sharp: from a fifth of
# the focus distance of an F01 to infinity.
_COARSE = np.arange(-2.0, 1.51, 0.5)
_FINE = np.arange(-2.0, 1.51, 0.05)
_AGREEING = 0.9  # least share of corners with correctly alternating squares


def find_board(board: Checkerboard, light_field: LightField,
               ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Approximate positions and disparities of the corners, (rows, columns, 2) px.

    light_field: of lattice-aligned views. The board's z axis points away from the camera.
    Raises LightFieldError when there is no complete board.
    """
    views = _Views(light_field)
    for picture in _pictures(light_field, views):
        positions = board.detected(picture)
        if positions is not None:
            disparities = views.disparities(positions)
            return positions, np.stack([disparities, disparities], axis=-1)
    raise LightFieldError(f'no complete board of {board.columns}x{board.rows} inner corners')


def oriented(board: Checkerboard, corners: Corners) -> Corners:
    """The corners from the board's first one on, as `Checkerboard` says.

    The x axis of a board with a symmetry of 180 degrees points to the right. Raises
    LightFieldError when the squares do not alternate: it is no checkerboard.
    """
    row, column = np.indices(corners.valid.shape)
    alternating = corners.contrasts * (-1) ** (row + column)
    lighter = np.mean(alternating[corners.valid] > 0) if corners.valid.any() else 0.5
    if max(lighter, 1 - lighter) < _AGREEING or corners.valid.mean() < _AGREEING:
        raise LightFieldError(
            f'the pattern is no board, or too blurred or partly covered: '
            f'{corners.valid.sum()} of {corners.valid.size} corners could be measured, at '
            f'{100 * max(lighter, 1 - lighter):.0f} % of them light and dark squares '
            'alternate')
    if (board.columns + board.rows) % 2:
        turn = lighter < 0.5
    else:
        turn = float(np.diff(corners.positions[..., 0], axis=1).sum()) < 0
    return corners.turned() if turn else corners


def _pictures(light_field: LightField, views: '_Views') -> Iterator[NDArray[np.uint8]]:
    """The centre view, then, less noisy, all views together, focused at several depths."""
    yield _visible(light_field.centre_view.mean(axis=-1))
    for disparity in sorted(_COARSE, key=abs):
        yield _visible(views.refocused(float(disparity)))


def _visible(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(height, width), stretched over the range from the darkest to the brightest."""
    dark, bright = np.percentile(linear, [1, 99])
    stretched = (linear - dark) / max(float(bright - dark), 1e-6)
    return np.rint(255 * np.sqrt(np.clip(stretched, 0, 1))).astype(np.uint8)


class _Views:
    """Grey views with light, and their positions."""

    def __init__(self, light_field: LightField) -> None:
        lit = light_field.grid.weights > 0
        self._views = light_field.views[lit].mean(axis=-1)
        self._positions = light_field.grid.positions[lit]

    def refocused(self, disparity: float, left: int = 0, top: int = 0, width: int | None = None,
                  height: int | None = None) -> NDArray[np.float32]:
        """The mean of the views, each moved back by `disparity` px per step, in a window."""
        shape = self._views.shape[1:]
        size = (width or shape[1], height or shape[0])
        total = np.zeros(size[::-1], np.float32)
        for view, (a, b) in zip(self._views, self._positions, strict=True):
            moved = np.array([[1, 0, left + disparity * a], [0, 1, top + disparity * b]])
            total += cv2.warpAffine(view, moved, size, borderMode=cv2.BORDER_REPLICATE,
                                    flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
        return np.asarray(total / np.float32(len(self._views)))

    def disparities(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """(rows, columns) px per step: where each corner is sharpest, all on one plane."""
        sides = [np.diff(positions, axis=axis).reshape(-1, 2) for axis in (0, 1)]
        half = max(2, math.floor(0.4 * min(np.hypot(*each.T).mean() for each in sides)))
        flat = positions.reshape(-1, 2)
        left, top = np.floor(flat.min(axis=0)).astype(int) - half - 2
        width, height = np.ceil(flat.max(axis=0) - flat.min(axis=0)).astype(int) + 2 * half + 5
        at = np.rint(flat - [left, top]).astype(int)
        sharpness = np.zeros((len(_FINE), len(flat)))
        for k, disparity in enumerate(_FINE):
            image = self.refocused(float(disparity), int(left), int(top), int(width), int(height))
            rows, columns = np.gradient(cv2.GaussianBlur(image, (0, 0), 0.8))
            energy = cv2.boxFilter(rows ** 2 + columns ** 2, -1, (2 * half + 1, 2 * half + 1))
            sharpness[k] = energy[at[:, 1], at[:, 0]]
        best = np.clip(sharpness.argmax(axis=0), 1, len(_FINE) - 2)
        before, peak, after = (sharpness[best + k, np.arange(len(flat))] for k in (-1, 0, 1))
        bend = np.minimum(before - 2 * peak + after, -1e-12)
        values = _FINE[best] + (_FINE[1] - _FINE[0]) * np.clip((before - after) / 2 / bend, -1, 1)
        affine = np.concatenate([np.ones((len(flat), 1)), flat], axis=1)
        weights = np.ones(len(flat))
        for _ in range(10):  # robust: a few corners may be wrong
            root = np.sqrt(weights)
            plane = np.linalg.lstsq(affine * root[:, None], values * root, rcond=None)[0]
            off = np.abs(values - affine @ plane)
            weights = 1 / (1 + (off / (1.5 * np.median(off) + 1e-3)) ** 2) ** 2
        return np.asarray(affine @ plane).reshape(positions.shape[:2])
