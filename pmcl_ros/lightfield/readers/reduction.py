"""Less of a light field than a source holds: every k-th view, coarser pixels."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import LightFieldError

# Of views as float32; the stages that follow need several times as much.
MOST_BYTES = 2 ** 30


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
