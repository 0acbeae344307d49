"""A printed checkerboard, and where a picture shows its corners."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.calibration.board_size import check_square, counts_from
from pmcl_ros.lightfield.calibration.subpixel import refined
from pmcl_ros.runtime.errors import SettingsError

_FEWEST = 3  # inner corners in a row and in a column: the detector's least
_ENLARGED = (1, 2)  # the detector is tried at these sizes of a view
_EFFORTS = (0, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE)
_FREE = 0.45  # of a square, to each side of a corner: short of the next corners' edges
_ALTERNATE = 0.5  # least share of contrast on a board, and most of the board's beside it


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
        found = self.detected(picture)
        if found is None or not self._is_whole(picture, found):
            return None
        first, last = (self._brightness(picture, each)
                       for each in (found[:2, :2], found[-2:, -2:]))
        oriented = found if first > last else found[::-1, ::-1]
        return refined(picture, oriented.reshape(-1, 2), self.points[:, :2] / self.square, _FREE)

    def _is_whole(self, picture: NDArray[np.uint8], found: NDArray[np.float64]) -> bool:
        """Whether squares alternate on the board, and not beside it.

        Else it is a part of a larger one, or each second corner of it: which, differs from picture
        to picture. found: as of `detected`.
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

    def detected(self, picture: NDArray[np.uint8]) -> NDArray[np.float64] | None:
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
