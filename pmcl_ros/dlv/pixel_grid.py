"""The pixels of the centre view for which evidence and volume are made."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import VolumeError


@dataclass(frozen=True)
class PixelGrid:
    """Every `stride`-th pixel of a window of the centre view, from its upper left on.

    whole: the centre view's pinhole. left, top, width, height: the window [px].
    """

    whole: Pinhole
    left: int
    top: int
    width: int
    height: int
    stride: int

    @classmethod
    def from_crop(cls, whole: Pinhole, crop: tuple[int, int, int, int], stride: int
                  ) -> 'PixelGrid':
        """crop: left, top, width, height [px]; a size of 0 is up to the image's end.

        Raises VolumeError when that is not within the image.
        """
        left, top, width, height = crop
        width, height = width or whole.width - left, height or whole.height - top
        if width < 1 or height < 1 or left + width > whole.width or top + height > whole.height:
            raise VolumeError(f'crop {list(crop)} (left, top, width, height) reaches out of views '
                              f'of {whole.width}x{whole.height} px; leave a size 0 for all of it')
        return cls(whole, left, top, width, height, stride)

    @property
    def pinhole(self) -> Pinhole:
        """The camera whose pixels these are."""
        window = self.whole.crop(self.left, self.top, self.width, self.height)
        return window.subsample(self.stride)

    @property
    def columns(self) -> NDArray[np.int64]:
        """(columns,) x of each in the centre view [px]."""
        return np.arange(self.left, self.left + self.width, self.stride)

    @property
    def rows(self) -> NDArray[np.int64]:
        """(rows,) y of each in the centre view [px]."""
        return np.arange(self.top, self.top + self.height, self.stride)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.rows), len(self.columns)

    def grown(self, steps: int) -> 'PixelGrid':
        """With up to `steps` more pixels of the lattice on each side, as far as the image goes."""
        stride = self.stride
        left = self.left - min(steps, self.left // stride) * stride
        top = self.top - min(steps, self.top // stride) * stride
        right = min(self.left + self.width + steps * stride, self.whole.width)
        bottom = min(self.top + self.height + steps * stride, self.whole.height)
        return PixelGrid(self.whole, left, top, right - left, bottom - top, stride)

    def within(self, other: 'PixelGrid') -> tuple[slice, slice]:
        """Where in arrays (rows, columns) of `other`, of the same lattice, these pixels are."""
        x, y = (self.left - other.left) // self.stride, (self.top - other.top) // self.stride
        return slice(y, y + len(self.rows)), slice(x, x + len(self.columns))
