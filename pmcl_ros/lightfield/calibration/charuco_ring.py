"""Find a ring of ArUco markers and chess corners, around an object, in an ordinary picture."""

from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.agreeing_corners import agreeing
from pmcl_ros.lightfield.calibration.board_size import check_square, counts_from
from pmcl_ros.lightfield.calibration.subpixel import refined
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

_WIDE = 2  # squares: the least with chess corners in the middle of the ring
_MARKER = 0.6  # side of a marker, in squares: the light around it lets corners be measured
_FEWEST, _MOST = 2 * _WIDE + 1, 500  # squares in a direction; in all, by the dictionary's markers
_LEAST = 8  # corners: with fewer, noise tilts the board
_MARGIN = 0.25  # squares
_HEIGHTS = -0.01, 0.3  # m: of the origin of what stands on the table
_FROM_CORNERS = 0.5 if cv2.__version__ < '5' else 0.0  # px: OpenCV 4 counts from pixels' corners
_MISREAD = 0.5  # squares
# Of blurred, overexposed or dark markers outlines are round, and a cell may be misread: the other
# numbers of the dictionary differ by three cells or more.
_READING = {'errorCorrectionRate': 1.0, 'maxErroneousBitsInBorderRate': 0.5,
            'polygonalApproxAccuracyRate': 0.05, 'perspectiveRemovePixelPerCell': 8}
_BLURS, _SHARPER = (0.7, 2.0), 4.0  # px; times the difference of these blurs is added
_BESIDE = 0.1  # squares from a corner, along both sides: before the markers
_COVERED = 0.25  # of the usual contrast
_NOISE = 0.5  # px: corners that are less off are not suspected
_TWICE = 0.25  # of the markers: some are read at a second place, as in a reflection or clutter
_OUTLIER = 4.0  # times the median distance from where the plane is expected


@dataclass(frozen=True)
class CharucoRing:
    """columns, rows: of squares, outside. square: side of a square [m].

    A ChArUco board of which the outer two rows and columns of squares are printed. The object
    stands in the empty middle. It may hide a part of the ring: each marker has a number. The frame
    is that of the middle: x along the rows to the right, y up the page, z out of it.
    Raises SettingsError for numbers that no ring has, and for an OpenCV that cannot detect it.
    """

    up = 1  # its z points out of what it lies on
    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < _FEWEST or self.columns * self.rows > _MOST:
            raise SettingsError(f'a ring of {self.columns}x{self.rows} squares cannot be used; it '
                                f'has {_FEWEST} or more in each direction, and an area of '
                                f'{_MOST} at most')
        check_square(self.square)
        if not hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector'):
            raise SettingsError(f'a ring needs OpenCV 4.7 or newer, this is {cv2.__version__}: '
                                'pip install -U opencv-python-headless, or use a checkerboard '
                                '(corners)')

    @classmethod
    def parse(cls, squares: str, square: float) -> 'CharucoRing':
        """squares: of the ring outside as COLUMNSxROWS, like 8x11. SettingsError for others."""
        return cls(*counts_from(squares, f'ring {squares!r} is not like 8x11: columns x rows of '
                                'squares'), square)

    @property
    def options(self) -> str:
        """The options of commands that name it."""
        return f'--ring {self.columns}x{self.rows} --square {self.square:g}'

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 3) the chess corners [m]."""
        every = np.asarray(self._board.getChessboardCorners(), float)[self._corners]
        return (every - [self.square * self.columns / 2, self.square * self.rows / 2, 0]) * [
            1, -1, 1]

    @property
    def region(self) -> tuple[float, float, float, float, float, float]:
        """Centre and size of the box where the origin of an object is that stands in the middle
        [m].
        """
        low, high = _HEIGHTS
        return (0.0, 0.0, (low + high) / 2, (self.columns - 2 * _WIDE) * self.square,
                (self.rows - 2 * _WIDE) * self.square, high - low)

    @property
    def svg(self) -> str:
        """The ring in its true size, with a light margin and a line that says what it is."""
        width, height = (1e3 * self.square * (count + 2 * _MARGIN)
                         for count in (self.columns, self.rows))
        side, margin = 1e3 * self.square, 1e3 * self.square * _MARGIN
        drawn = [_rectangle(margin + side * column, margin + side * row, side)
                 for row, column in np.ndindex(self.rows, self.columns)
                 if (row + column) % 2 == 0 and self._is_printed(row, column)]
        # Light cells over a dark marker: dark ones beside each other may show a seam.
        cells = self._board.getDictionary().markerSize + 2
        cell = _MARKER * side / cells
        for number, corners in zip(np.ravel(self._board.getIds()), self._board.getObjPoints(),
                                   strict=True):
            left, top = margin + 1e3 * np.asarray(corners, float)[:, :2].min(axis=0)
            if not self._is_printed(int((top - margin) // side), int((left - margin) // side)):
                continue
            drawn.append(_rectangle(left, top, cells * cell))
            image = cv2.aruco.generateImageMarker(self._board.getDictionary(), int(number), cells)
            drawn += [_rectangle(left + column * cell, top + row * cell, cell, 'white')
                      for row, column in np.argwhere(image > 0)]
        text = (f'<text x="{margin:g}" y="{height - margin / 4:g}" font-size="{margin / 2:g}" '
                f'fill="grey">{self.options}</text>\n')
        return ('<svg xmlns="http://www.w3.org/2000/svg" '
                f'width="{width:g}mm" height="{height:g}mm" viewBox="0 0 {width:g} {height:g}" '
                f'shape-rendering="crispEdges">\n{"".join(drawn)}{text}</svg>\n')

    def seen(self, picture: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """(n, 2) px of the corners in a grey picture, as `points`; NaN: not seen.

        None where fewer than eight are seen, or those of one side alone. Raises LightFieldError
        for two such rings.
        """
        best = self._detected(picture, 1)
        for of, scale in ((picture, 2), (_sharpened(picture), 1)):
            if not np.isfinite(best).all():  # each attempt reads other markers
                best = np.where(np.isfinite(best), best, self._detected(of, scale))
        shown = np.flatnonzero(np.isfinite(best[:, 0]))
        squares = self.points[:, :2] / self.square
        # A marker that is read as another one puts its corners squares away.
        onto = _homography(best[shown], squares[shown])
        shown = shown[_off(onto, best[shown], squares[shown]) < _MISREAD]
        if len(shown) < _LEAST:
            return None
        seen = np.full(best.shape, np.nan)
        seen[shown] = refined(picture, best[shown], squares[shown], (1 - _MARKER) / 2)
        contrasts = self._contrasts(picture, seen)
        seen[~(contrasts > _COVERED * np.nanmedian(contrasts))] = np.nan
        return self._if_enough(seen)

    def _contrasts(self, picture: NDArray[np.uint8], corners: NDArray[np.float64]
                   ) -> NDArray[np.float64]:
        """(n,) by how much the darkest light square at a corner is lighter than the lightest dark.
        """
        shown = np.isfinite(corners[:, 0])
        squares = self.points[shown, :2] / self.square
        onto = _homography(squares, corners[shown])
        if onto is None:
            return np.full(len(corners), np.nan)
        here, *beside = (cv2.perspectiveTransform((squares + _BESIDE * np.array(step))[:, None],
                                                  onto)[:, 0]
                         for step in ((0, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)))
        x, y = np.moveaxis(corners[shown] + np.array(beside) - here, -1, 0).astype(np.float32)
        light = cv2.remap(picture, x, y, cv2.INTER_LINEAR).astype(float)
        column, row = np.rint(squares * [1, -1] + np.array([self.columns, self.rows]) / 2).T
        is_dark = (row + column).astype(int) % 2 == 0  # the square up to the left
        rising, falling = light[:2], light[2:]
        found = np.full(len(corners), np.nan)
        found[shown] = np.where(is_dark, rising.min(axis=0) - falling.max(axis=0),
                                falling.min(axis=0) - rising.max(axis=0))
        return found

    def near_plane(self, corners: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """What `seen` gives, without corners that are much farther off a plane than most.

        corners: as of `seen`, of a camera without distortion. Behind glass a corner is seen aside.
        """
        shown = np.flatnonzero(np.isfinite(corners[:, 0]))
        plane = self.points[shown, :2]
        off = np.full(len(corners), np.nan)
        off[shown] = _off(_homography(plane, corners[shown]), plane, corners[shown])
        return self.near(corners, off)

    def near(self, corners: NDArray[np.float64], off: NDArray[np.float64]
             ) -> NDArray[np.float64] | None:
        """What `seen` gives, without corners that are much farther off than most.

        off: (n,) distances from where they are expected [px], NaN: not seen.
        """
        most = max(_OUTLIER * float(np.nanmedian(off)), _NOISE)
        return self._only(corners, np.flatnonzero(off < most))

    def agreeing(self, corners: NDArray[np.float64], pinhole: Pinhole,
                 points: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """What `near` gives, without corners that are off where the others have them.

        points: as `points`, of a sheet that may be bent.
        """
        shown = np.flatnonzero(np.isfinite(corners[:, 0]))
        return self._only(corners, shown[agreeing(points[shown], corners[shown], pinhole, _LEAST)])

    def _only(self, corners: NDArray[np.float64], shown: NDArray[np.intp]
              ) -> NDArray[np.float64] | None:
        """The corners with these numbers; None where they are not enough."""
        left = np.full(corners.shape, np.nan)
        left[shown] = corners[shown]
        return self._if_enough(left)

    def _if_enough(self, corners: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The corners, but None where there are too few, or all on a line."""
        there = self.points[np.isfinite(corners[:, 0]), :2]
        is_enough = len(there) >= _LEAST and np.ptp(there, axis=0).min() > 0
        return corners if is_enough else None

    def _detected(self, picture: NDArray[np.uint8], scale: int) -> NDArray[np.float64]:
        """(n, 2) px of the corners, as `points`, found in the picture `scale` times as large."""
        enlarged = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        detector = cv2.aruco.CharucoDetector(self._board)
        settings = detector.getCharucoParameters()  # given to it at once they crash OpenCV 4.7
        settings.minMarkers = 1  # beside a corner: the object may hide the other one
        if hasattr(settings, 'checkMarkers'):  # one that is read at a second place, too, is enough
            settings.checkMarkers = False      # for it to refuse them all; `seen` sorts them out
        detector.setCharucoParameters(settings)
        reading = detector.getDetectorParameters()
        for name, value in _READING.items():
            setattr(reading, name, value)
        detector.setDetectorParameters(reading)
        positions, numbers, _, markers = detector.detectBoard(enlarged)
        if markers is not None and len(markers):
            times = np.unique(markers, return_counts=True)[1]
            if (times > 1).sum() > _TWICE * len(self._corners):  # about as many as markers
                raise LightFieldError(f'there are two rings of {self.options} in view: cover one, '
                                      'or print another size, which has other markers')
        every = np.full(((self.rows - 1) * (self.columns - 1), 2), np.nan)
        if numbers is not None and len(numbers):
            middles = np.reshape(positions, (-1, 2)) - _FROM_CORNERS  # 0: the middle of a pixel
            every[np.ravel(numbers)] = (middles + 0.5) / scale - 0.5
        return every[self._corners]

    @cached_property
    def _board(self) -> 'cv2.aruco.CharucoBoard':  # old versions of OpenCV have none
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square, _MARKER * self.square, self._markers)

    @property
    def _markers(self) -> 'cv2.aruco.Dictionary':
        """Those of the whole board, row by row, in an order that no other numbers have.

        In one order for all, most markers of a ring with more rows would be at the same places,
        and it would be taken for this one, whose middle is elsewhere.
        """
        given = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
        order = sorted(range(len(given.bytesList)), key=lambda number: sha256(
            f'{self.columns}x{self.rows} {number}'.encode()).digest())
        return cv2.aruco.Dictionary(given.bytesList[order[:self.columns * self.rows // 2]],
                                    given.markerSize, given.maxCorrectionBits)

    @property
    def _corners(self) -> NDArray[np.int64]:
        """(n,) which of the whole board's inner corners have four squares of the ring around."""
        row, column = np.indices((self.rows - 1, self.columns - 1)) + 1
        return np.flatnonzero((row == 1) | (row == self.rows - 1) | (column == 1)
                              | (column == self.columns - 1))

    def _is_printed(self, row: int, column: int) -> bool:
        return (min(row, self.rows - 1 - row) < _WIDE
                or min(column, self.columns - 1 - column) < _WIDE)


def _sharpened(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture (height, width) in which cells of blurred markers differ."""
    fine, coarse = (cv2.GaussianBlur(picture, (0, 0), each).astype(np.float32) for each in _BLURS)
    return np.asarray(np.clip(picture + _SHARPER * (fine - coarse), 0, 255), np.uint8)


def _homography(points: NDArray[np.float64], seen: NDArray[np.float64]
                ) -> NDArray[np.float64] | None:
    """(3, 3) what moves most of the points (m, 2) to where they are seen: least median of squares.
    """
    if len(points) < 4:
        return None
    onto, _ = cv2.findHomography(points, seen, cv2.LMEDS)
    return None if onto is None else np.asarray(onto, float)


def _off(onto: NDArray[np.float64] | None, points: NDArray[np.float64], seen: NDArray[np.float64]
         ) -> NDArray[np.float64]:
    """(m,) distances of the points (m, 2), moved so, from those seen; infinite without it."""
    if onto is None:
        return np.full(len(points), np.inf)
    return np.asarray(np.linalg.norm(
        cv2.perspectiveTransform(points[:, None], onto)[:, 0] - seen, axis=1))


def _rectangle(left: float, top: float, side: float, fill: str = 'black') -> str:
    return (f'<rect x="{left:.6g}" y="{top:.6g}" width="{side:.6g}" height="{side:.6g}" '
            f'fill="{fill}"/>\n')
