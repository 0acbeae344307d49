"""Larger pixels: where the object is large in pictures, or memory would not suffice."""

import logging
import math
from dataclasses import replace
from functools import lru_cache
from typing import TypeVar, cast

import numpy as np

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.runtime.errors import VolumeError

_LOG = logging.getLogger(__name__)
Source = TypeVar('Source', bound=LightField | PosedView | PosedViews)
# Of a picture: those that are larger get as many as the network sees at least, and a side that the
# search draws on the processor (`raster.LARGEST`). A pixel's evidence takes 200 bytes at most, its
# blurred forms included.
MOST_PIXELS, _LONGEST = 2 ** 22, 1800
_MOST_BYTES, _BYTES = 3 * 2 ** 30, 100  # of all evidence; of a pixel at one depth
_SEARCHED = 160.0  # px: size of an object in the pictures that the search is made for


def bin_side(size: float) -> int:
    """Side of the squares of pixels that make an object of this size [px] `_SEARCHED` large."""
    return max(1, round(size / _SEARCHED))


def binned(view: PosedView, larger: int) -> PosedView:
    """A view in which squares of `larger` pixels are one."""
    reduction = Reduction(1, larger)
    picture = np.clip(reduction.shrunk(view.picture), 0, 1)
    return replace(view, picture=picture, pinhole=reduction.pinhole(view.pinhole),
                   mask=None if view.mask is None else reduction.shrunk_mask(view.mask))


def binned_to_fit(source: Source, settings: DlvSettings) -> Source:
    """What evidence is made of: pictures of more than `MOST_PIXELS` with larger pixels.

    So have views so many that all would take too much memory. As it is where the settings cut out
    a part, whose numbers are of these pixels.
    """
    if any(settings.crop) or isinstance(source, LightField):
        return source
    if isinstance(source, PosedViews):
        most = min(_MOST_BYTES // (2 * _BYTES * len(source.views)), MOST_PIXELS)
        return replace(source, views=tuple(_binned_to_fit(each, most) for each in source.views))
    return cast(Source, _binned_to_fit(source, MOST_PIXELS))


def _binned_to_fit(view: PosedView, most: int) -> PosedView:
    width, height = view.pinhole.width, view.pinhole.height
    if width * height <= most:
        return view
    larger = max(_needed(width * height, most), math.ceil(max(width, height) / _LONGEST))
    _tell(width, height, larger)
    return binned(view, larger)


def drawable(view: PosedView, side: int, most: int) -> PosedView:
    """A view, binned where a part of it with this longer side [px] has more than `most`."""
    if side <= most:
        return view
    larger = math.ceil(side / (most - 2))  # a part that begins within a pixel has two more
    _tell(view.pinhole.width, view.pinhole.height, larger)
    return binned(view, larger)


@lru_cache(maxsize=16)  # logged once, not at every picture
def _tell(width: int, height: int, larger: int) -> None:
    _LOG.info('pictures of %dx%d px are binned %dx%d', width, height, larger, larger)


def check_memory(lattice: PixelGrid, depths: int) -> None:
    """Raise VolumeError where contour maps of some pixels at some depths take too much memory."""
    size = _BYTES * lattice.width * lattice.height * depths
    if size > _MOST_BYTES:
        raise VolumeError(
            f'evidence of {lattice.width}x{lattice.height} px at {depths} depths needs '
            f'{size / 2 ** 30:.1f} GiB, more than {_MOST_BYTES / 2 ** 30:.0f}: make pixels '
            f'{_needed(size, _MOST_BYTES)} times as large (--shrink), or take a smaller part')


def _needed(size: int, most: int) -> int:
    """Side of the squares of pixels that bring a size below the most that is possible."""
    return math.ceil(math.sqrt(size / most))
