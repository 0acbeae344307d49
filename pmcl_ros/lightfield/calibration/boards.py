"""Find a checkerboard in the views of a light field."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.calibration.board_size import check_square, counts_from
from pmcl_ros.lightfield.calibration.corners import Corners
from pmcl_ros.lightfield.calibration.subpixel import refined
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

_FEWEST = 3  # inner corners in a row and in a column: the detector's least
_ENLARGED = (1, 2)  # the detector is tried at these sizes of a view
_EFFORTS = (0, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE)
# Disparities of lattice-aligned views [px per step] at which a board may be sharp: from a fifth of
# the focus distance of an F01 to infinity.
_COARSE = np.arange(-2.0, 1.51, 0.5)
_FINE = np.arange(-2.0, 1.51, 0.05)
_FREE = 0.45  # of a square, to each side of a corner: short of the next corners' edges
_ALTERNATE = 0.5  # least share of contrast on a board, and most of the board's beside it
_AGREEING = 0.9  # least share of corners with correctly alternating squares


@dataclass(frozen=True)
class Checkerboard:
    """columns, rows: of inner corners. square: side of a square [m].

    The first inner corner is the one beside a light corner square of the board. This resolves a
    turn by 180 degrees if one of columns and rows is odd and the other even.
    """

    up = -1  # its z points into what it lies on
    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < _FEWEST or max(self.columns, self.rows) > 100:
            raise SettingsError(f'a board of {self.columns}x{self.rows} inner corners cannot be '
                                f'used; it needs {_FEWEST} to 100 in each direction')
        check_square(self.square)

    @classmethod
    def parse(cls, corners: str, square: float) -> 'Checkerboard':
        """corners: inner corners as COLUMNSxROWS, like 10x7. SettingsError for anything else."""
        return cls(*counts_from(corners, f'corners {corners!r} are not like 10x7: columns x rows '
                                'of inner corners'), square)

    @property
    def options(self) -> str:
        """The options of commands that name it."""
        return f'--corners {self.columns}x{self.rows} --square {self.square:g}'

    @property
    def points(self) -> NDArray[np.float64]:
        """(rows * columns, 3) the inner corners, row by row, in the board's plane [m]."""
        row, column = np.indices((self.rows, self.columns))
        flat = self.square * np.stack([column, row], axis=-1).reshape(-1, 2)
        return np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)

    @property
    def svg(self) -> str:
        """The board in its true size, with a light margin that is one square wide.

        Raises SettingsError for a board whose turn by 180 degrees cannot be told.
        """
        self.check_turn()
        side = 1e3 * self.square
        width, height = (side * (inner + 3) for inner in (self.columns, self.rows))
        dark = ''.join(
            f'<rect x="{side * (column + 1):g}" y="{side * (row + 1):g}" width="{side:g}" '
            f'height="{side:g}"/>\n' for row, column in np.ndindex(self.rows + 1, self.columns + 1)
            if (row + column) % 2)
        return ('<svg xmlns="http://www.w3.org/2000/svg" '
                f'width="{width:g}mm" height="{height:g}mm" '
                f'viewBox="0 0 {width:g} {height:g}">\n{dark}</svg>\n')

    def check_turn(self) -> None:
        """Raise SettingsError for a board whose turn by 180 degrees cannot be told."""
        if (self.columns + self.rows) % 2 == 0:
            raise SettingsError(f'a board of {self.columns}x{self.rows} inner corners looks the '
                                'same upside down; one number must be odd, the other even')

    def seen(self, picture: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """(rows * columns, 2) px of the corners in a grey picture, as `points`; None: no board.

        A part of a larger one is none.
        Raises SettingsError for a board whose turn by 180 degrees cannot be told.
        """
        self.check_turn()
        found = self._detected(picture)
        if found is None or not self._is_whole(picture, found):
            return None
        first, last = (self._brightness(picture, each)
                       for each in (found[:2, :2], found[-2:, -2:]))
        oriented = found if first > last else found[::-1, ::-1]
        return refined(picture, oriented.reshape(-1, 2), self.points[:, :2] / self.square, _FREE)

    def _is_whole(self, picture: NDArray[np.uint8], found: NDArray[np.float64]) -> bool:
        """Whether squares alternate on the board, and not beside it.

        Else it is a part of a larger one, or each second corner of it: which, differs from picture
        to picture. found: as of `_detected`.
        """
        onto, _ = cv2.findHomography(self.points[:, :2] / self.square, found.reshape(-1, 2))
        if onto is None:
            return False
        places = np.stack(np.meshgrid(np.arange(self.columns + 3) - 1.5,
                                      np.arange(self.rows + 3) - 1.5), axis=-1)
        x, y = np.moveaxis(cv2.perspectiveTransform(places, onto).astype(np.float32), -1, 0)
        light = cv2.remap(picture, x, y, cv2.INTER_LINEAR,
                          borderMode=cv2.BORDER_REPLICATE).astype(float)
        row, column = np.indices(light.shape)
        sign = (-1.0) ** (row + column)

        def alternating(*part: int | slice) -> float:
            """How much light and dark differ there, in turn."""
            return abs(float(((light[part] - light[part].mean()) * sign[part]).mean()))

        inside = slice(1, -1), slice(1, -1)
        contrast = alternating(*inside)
        beside = max(alternating(each, inside[1]) for each in (0, -1)), max(
            alternating(inside[0], each) for each in (0, -1))
        return contrast > _ALTERNATE * light[inside].std() and max(beside) < _ALTERNATE * contrast

    @staticmethod
    def _brightness(picture: NDArray[np.uint8], square: NDArray[np.float64]) -> float:
        """Of the middle of a square, of which the corners (2, 2, 2) are given [px]."""
        x, y = np.rint(square.mean(axis=(0, 1))).astype(int)
        reach = max(1, int(0.2 * np.linalg.norm(square[0, 0] - square[1, 1])))
        return float(picture[max(y - reach, 0):y + reach + 1,
                             max(x - reach, 0):x + reach + 1].mean())

    def find(self, light_field: LightField,
             ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Approximate positions and disparities of the corners, (rows, columns, 2) px.

        light_field: of lattice-aligned views. The board's z axis points away from the camera.
        Raises LightFieldError when there is no complete board.
        """
        views = _Views(light_field)
        for picture in _pictures(light_field, views):
            positions = self._detected(picture)
            if positions is not None:
                disparities = views.disparities(positions)
                return positions, np.stack([disparities, disparities], axis=-1)
        raise LightFieldError(f'no complete board of {self.columns}x{self.rows} inner corners')

    def oriented(self, corners: Corners) -> Corners:
        """The corners from the board's first one on, as the class says.

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
        if (self.columns + self.rows) % 2:
            turn = lighter < 0.5
        else:
            turn = float(np.diff(corners.positions[..., 0], axis=1).sum()) < 0
        return corners.turned() if turn else corners

    def _detected(self, picture: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """(rows, columns, 2) px of the corners in one picture."""
        for scale in _ENLARGED:
            enlarged = cv2.resize(picture, None, fx=scale, fy=scale,
                                  interpolation=cv2.INTER_CUBIC)
            for effort in _EFFORTS:
                found, corners = cv2.findChessboardCornersSB(
                    enlarged, (self.columns, self.rows), flags=effort)
                if found:
                    positions = (corners.reshape(self.rows, self.columns, 2).astype(float)
                                 + 0.5) / scale - 0.5
                    along = np.diff(positions, axis=1).mean(axis=(0, 1))
                    down = np.diff(positions, axis=0).mean(axis=(0, 1))
                    mirrored = along[0] * down[1] < along[1] * down[0]
                    return np.asarray(positions[::-1] if mirrored else positions)
        return None


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
