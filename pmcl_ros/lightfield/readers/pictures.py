"""Pictures of views: reading, linear light, reduction and sub-pixel shifts."""

import logging
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import LightFieldError, PictureError, told_as
from pmcl_ros.runtime.picture_file import read_picture_file, read_picture_size

_Read = TypeVar('_Read')
_LOG = logging.getLogger(__name__)
MOST_BYTES = 3 * 2 ** 28  # of views as float32
_DEEPEST = 16  # bits
_DARK = 14  # bits: an exposed picture of 16 bits has brighter values than these hold
_HALF = 3  # pixels each side: a polynomial of the fifth degree through six


Bits = Annotated[int, Field(ge=9, le=_DEEPEST, description='bits of a value in 16-bit '
                            'pictures: 10 or 12 for many industrial cameras, whose white is 1023 '
                            'or 4095 [bits]')]


@dataclass(frozen=True)
class Reduction:
    """Coarser sampling of a light field: fewer views, larger pixels.

    every: each `every`-th view is kept, counted from the centre view.
    shrink: side of the squares of pixels that are averaged to one.
    """

    every: int = 1
    shrink: int = 1

    def __post_init__(self) -> None:
        if self.every < 1 or self.shrink < 1:
            raise LightFieldError(f'every {self.every} and shrink {self.shrink} must be 1 or more')

    def kept(self, count: int) -> list[int]:
        """Indices of the kept rows or columns of `count`; count // 2 stays the centre."""
        return list(range(count // 2 % self.every, count, self.every))

    def pinhole(self, pinhole: Pinhole) -> Pinhole:
        """The pinhole of shrunk pictures; incomplete squares at the right and below are cut."""
        n = self.shrink
        width, height = pinhole.width // n, pinhole.height // n
        if width < 1 or height < 1:
            raise LightFieldError(f'views of {pinhole.width}x{pinhole.height} cannot be shrunk by '
                                  f'{n}; choose less')
        return pinhole.crop(0, 0, n * width, n * height).resized(width, height)

    def shrunk(self, picture: NDArray[np.float32]) -> NDArray[np.float32]:
        """(height, width[, 3]) means of the squares of pixels."""
        n = self.shrink
        if n == 1:
            return picture
        height, width = picture.shape[0] // n, picture.shape[1] // n
        return np.asarray(cv2.resize(picture[:height * n, :width * n], (width, height),
                                     interpolation=cv2.INTER_AREA))

    def shrunk_mask(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(height, width): the squares of which all pixels are True."""
        return np.asarray(self.shrunk(mask.astype(np.float32)) >= 1)

    def check_memory(self, rows: int, columns: int, height: int, width: int) -> None:
        """Raise LightFieldError if views of this number and size, shrunk, exceed `MOST_BYTES`."""
        size = rows * columns * (height // self.shrink) * (width // self.shrink) * 3 * 4
        if size > MOST_BYTES:
            factor = math.ceil(math.sqrt(size / MOST_BYTES))
            raise LightFieldError(
                f'{rows}x{columns} views of {width // self.shrink}x{height // self.shrink} px '
                f'need {size / 2 ** 20:.0f} MiB, more than {MOST_BYTES // 2 ** 20}: take every '
                f'{factor * self.every}th view (--every {factor * self.every}) or shrink the '
                f'pictures (--shrink {factor * self.shrink})')


def read_picture(path: Path, bits: int = _DEEPEST) -> NDArray[Any]:
    """(height, width, 3) RGB of the file's type: uint8, uint16 (`full_range`) or float32.

    Raises LightFieldError when the file is missing, no picture, or of another type.
    """
    picture = _of_view(path, lambda path: read_picture_file(
        path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH))
    if picture.dtype not in (np.uint8, np.uint16, np.float32):
        raise LightFieldError(f'{path} holds {picture.dtype} values; expected 8 or 16 bits, or '
                              '32-bit floating point')
    with told_as(LightFieldError, name=path):
        return full_range(np.asarray(picture[..., ::-1]), bits)


def picture_size(path: Path) -> tuple[int, int]:
    """(width, height) [px] by its header. Raises LightFieldError when it is missing or none."""
    return _of_view(path, read_picture_size)


def _of_view(path: Path, read: Callable[[Path], _Read]) -> _Read:
    if not os.path.isfile(path):  # which takes any name
        raise LightFieldError(f'there is no {path}; every view needs its file')
    with told_as(LightFieldError, PictureError):
        return read(path)


def full_range(values: NDArray[Any], bits: int) -> NDArray[Any]:
    """A camera's values; of uint16 those that have `bits` only are scaled, to 65535 at white.

    A warning tells, once for each number of bits, values that seem to have fewer. Raises
    LightFieldError for values that have more.
    """
    if values.dtype != np.uint16 or not values.size:
        return values
    largest, white = int(values.max()), 2 ** bits - 1
    if largest > white:
        raise LightFieldError(f'its largest value is {largest}, that of {bits} bits is {white}: '
                              'set bits to what the camera gives')
    if bits < _DEEPEST:
        return np.rint(np.arange(white + 1) * (65535 / white)).astype(np.uint16)[values]
    if 0 < largest < 2 ** _DARK:
        _tell_dark(largest.bit_length())
    return values


@cache
def _tell_dark(bits: int) -> None:
    _LOG.warning('a 16-bit picture has no value above %d: it is taken as almost black. If its '
                 'camera gives 10 or 12 bits, set bits to that (in views.yaml, light_field.yaml, '
                 'sweep.yaml, sweep_driver)', 2 ** bits - 1)


def linear_light(picture: NDArray[Any], gamma: float) -> NDArray[np.float32]:
    """Linear light, 1 at white, of values uint8, uint16 or float32 encoded by 1 / gamma."""
    if picture.dtype == np.float32:
        return np.maximum(picture, np.float32(0)) ** np.float32(gamma)
    white = np.iinfo(picture.dtype).max
    table = ((np.arange(white + 1) / white) ** gamma).astype(np.float32)
    return np.asarray(table[picture])


def shifted(picture: NDArray[np.float32], x: float, y: float) -> NDArray[np.float32]:
    """`picture` (height, width, 3) read at every pixel plus (x, y) [px].

    The border is replicated (as in matching) and negative ringing clipped to 0. Shifts by whole
    pixels are exact. cv2.remap would round shifts to 1/32 px.
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
