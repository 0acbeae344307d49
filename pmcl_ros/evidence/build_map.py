"""LightField or PosedView -> ContourMap."""

import logging

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.binning import bin_side, check_memory
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.contour_net import contour_net
from pmcl_ros.evidence.learned import LearnedMapEvidence, learned_map_evidence
from pmcl_ros.evidence.refocusing import refocused
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView, centre_view, exposed

_LOG = logging.getLogger(__name__)
REFOCUSED = 3  # depths of a light field, uniform in inverse depth
_CONTEXT = 48  # px around a crop that the network sees too
_MOST_INSIDE = 4.0  # nat: log odds of the inside that are larger are too sure
_LEAST = 64  # px: no map is made smaller


def build_map(source: LightField | PosedView, settings: DlvSettings,
              numbers: LearnedMapEvidence | None = None, size: float = 0.0) -> ContourMap:
    """The contour map of a capture, for the pixels of `PixelGrid.from_crop` the settings.

    Of a light field: of the inner views, refocused at `REFOCUSED` depths. Of one picture: the same
    at all depths, and nothing where its mask is False.
    settings: depths, inner views and crop. numbers: by default those that the package ships.
    size: of the object in one picture [px]. Where it is large, the search begins in the map with
    larger pixels.
    Raises VolumeError for an impossible crop, for too many pixels and as `refocused`,
    PictureError, SettingsError without a network.
    """
    pinhole = source.pinhole
    lattice = PixelGrid.from_crop(pinhole, settings.crop, settings.stride)
    check_memory(lattice, REFOCUSED if isinstance(source, LightField) else 2)
    if isinstance(source, LightField):
        depths = depth_labels(settings.near, settings.far, REFOCUSED)
        pictures = exposed(np.moveaxis(refocused(source, depths, settings.views), 1, -1))
    else:
        warn_of_one_colour(source, settings.crop)
        depths = depth_labels(settings.near, settings.far, 2)
        pictures = source.picture[None]
    tensor = np.empty((*lattice.shape, len(pictures), ContourMap.components), np.float32)
    inside = np.empty(tensor.shape[:3], np.float32)
    for label, each in enumerate(pictures):
        odds = _log_odds(each, lattice)
        tensor[:, :, label] = odds[..., :-1]
        inside[:, :, label] = odds[..., -1].clip(-_MOST_INSIDE, _MOST_INSIDE)
    if isinstance(source, PosedView) and source.mask is not None:  # log odds of 0 say nothing
        hidden = ~source.mask[lattice.rows[:, None], lattice.columns]
        tensor[hidden] = inside[hidden] = 0
    larger = min(bin_side(size / settings.stride), min(lattice.shape) // _LEAST)
    return ContourMap(source.header, tensor, depths, lattice.pinhole, inside,
                      numbers or learned_map_evidence(),
                      1 if isinstance(source, LightField) else larger)


def warn_of_one_colour(source: LightField | PosedView,
                       crop: tuple[int, int, int, int] = (0, 0, 0, 0)) -> None:
    """Log a warning where a picture, or the centre view, shows nothing.

    crop: of the part that is looked at, as of `PixelGrid.from_crop`.
    """
    view = centre_view(source) if isinstance(source, LightField) else source
    part = PixelGrid.from_crop(view.pinhole, crop, 1)
    if view.is_of_one_colour(part.left, part.top, part.width, part.height):
        _LOG.warning('%s is of one colour: is the lens covered, is it dark, or are its values of '
                     '10 or 12 bits not scaled to 16?', view.name or 'a picture')


def _log_odds(picture: NDArray[np.float32], lattice: PixelGrid) -> NDArray[np.float32]:
    """(rows, columns, 6) of the pixels of a lattice, seen with `_CONTEXT` around them."""
    left, top = max(lattice.left - _CONTEXT, 0), max(lattice.top - _CONTEXT, 0)
    seen = picture[top:lattice.top + lattice.height + _CONTEXT,
                   left:lattice.left + lattice.width + _CONTEXT]
    return contour_net()(seen)[lattice.rows[:, None] - top, lattice.columns - left]
