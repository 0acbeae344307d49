"""Views from pictures: every k-th one, coarser pixels, shifts by parts of a pixel."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import LightFieldError

# Of views as float32; the stages that follow need several times as much.
MOST_BYTES = 2 ** 30
_HALF = 3  # pixels each side: a polynomial of the fifth degree through six


@dataclass(frozen=True)
class Reduction:
    """What is left out when a light field is read.

    every: each how many-th view is kept, counted from the centre view.
    shrink: side of the squares of pixels that become one.
    """

    every: int = 1
    shrink: int = 1

    def __post_init__(self) -> None:
        if self.every < 1 or self.shrink < 1:
            raise LightFieldError(f'every {self.every} and shrink {self.shrink} must be 1 or more')

    def kept(self, count: int) -> list[int]:
        """Which of `count` rows or columns are kept; the centre, count // 2, stays the centre."""
        return list(range(count // 2 % self.every, count, self.every))

    def pinhole(self, pinhole: Pinhole) -> Pinhole:
        """The camera of the shrunk pictures; a rest of pixels at the right and below is cut."""
        n = self.shrink
        width, height = pinhole.width // n, pinhole.height // n
        if width < 1 or height < 1:
            raise LightFieldError(f'views of {pinhole.width}x{pinhole.height} cannot be shrunk by '
                                  f'{n}; choose less')
        return pinhole.crop(0, 0, n * width, n * height).resized(width, height)

    def shrunk(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        """(height, width, 3), each square of pixels its mean."""
        n = self.shrink
        if n == 1:
            return picture
        height, width = picture.shape[0] // n, picture.shape[1] // n
        return np.asarray(cv2.resize(picture[:height * n, :width * n], (width, height),
                                     interpolation=cv2.INTER_AREA))

    def check_memory(self, rows: int, columns: int, height: int, width: int) -> None:
        """Raise LightFieldError when so many views of so many pixels, shrunk, are too much."""
        size = rows * columns * (height // self.shrink) * (width // self.shrink) * 3 * 4
        if size > MOST_BYTES:
            factor = math.ceil(math.sqrt(size / MOST_BYTES))
            raise LightFieldError(
                f'{rows}x{columns} views of {width // self.shrink}x{height // self.shrink} px '
                f'need {size / 2 ** 30:.1f} GiB, more than {MOST_BYTES / 2 ** 30:.0f}: take every '
                f'{factor * self.every}th view (--every {factor * self.every}) or shrink the '
                f'pictures (--shrink {factor * self.shrink})')


def shifted(picture: NDArray[np.float32], x: float, y: float) -> NDArray[np.float32]:
    """`picture` (height, width, 3) read at every pixel plus (x, y) [px].

    Outside, the border's values go on (as in matching); what rings below 0 becomes 0. Whole pixels
    are exact. The place is exact too, unlike with cv2.remap, which knows 32 places in a pixel.
    """
    if x == y == 0:
        return picture
    height, width = picture.shape[:2]
    columns, across = _taps(x, width)
    rows, down = _taps(y, height)
    around = np.ascontiguousarray(picture[rows][:, columns])
    anchor = (_HALF - 1, _HALF - 1)
    filtered = cv2.sepFilter2D(around, cv2.CV_32F, across, down, anchor=anchor)
    inside = filtered[_HALF - 1:_HALF - 1 + height, _HALF - 1:_HALF - 1 + width]
    return np.maximum(inside, np.float32(0))


def _taps(shift: float, size: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The pixels that are read for a row of `size`, and the weights of each one's neighbours."""
    whole = math.floor(shift)
    places = np.arange(1 - _HALF, size + _HALF) + whole
    nodes = np.arange(1 - _HALF, _HALF + 1)
    gaps = nodes[:, None] - nodes + np.eye(len(nodes))  # 1 where a node meets itself
    parts = np.where(np.eye(len(nodes), dtype=bool), 1, (shift - whole - nodes) / gaps)
    return np.clip(places, 0, size - 1), parts.prod(axis=1)  # Lagrange's form
