"""LightField or PosedView -> ContourMap."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.contour_net import ContourNet, contour_net
from pmcl_ros.evidence.learned import LearnedMapEvidence, learned_map_evidence
from pmcl_ros.evidence.refocusing import refocused
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView, exposed

REFOCUSED = 3  # depths of a light field, uniform in inverse depth
_CONTEXT = 48  # px around a crop that the network sees too
_MOST_INSIDE = 4.0  # nat: log odds of the inside that are larger are too sure


def build_map(source: LightField | PosedView, settings: DlvSettings,
              net: ContourNet | None = None, numbers: LearnedMapEvidence | None = None
              ) -> ContourMap:
    """The contour map of a capture, for the pixels of `PixelGrid.from_crop` the settings.

    Of a light field: of the inner views, refocused at `REFOCUSED` depths. Of one picture: the same
    at all depths.
    settings: depths, inner views and crop. net, numbers: by default those that the package ships.
    Raises VolumeError for an impossible crop and as `refocused`, PictureError, SettingsError
    without a network.
    """
    pinhole = source.pinhole
    lattice = PixelGrid.from_crop(pinhole, settings.crop, settings.stride)
    if isinstance(source, LightField):
        depths = depth_labels(settings.near, settings.far, REFOCUSED)
        pictures = exposed(np.moveaxis(refocused(source, depths, settings.views), 1, -1))
    else:
        depths = depth_labels(settings.near, settings.far, 2)
        pictures = source.picture[None]
    net = net or contour_net()
    odds = np.stack([_log_odds(each, lattice, net) for each in pictures], axis=2)
    if len(pictures) < len(depths):
        odds = np.repeat(odds, len(depths), axis=2)
    inside = odds[..., 5].clip(-_MOST_INSIDE, _MOST_INSIDE)
    return ContourMap(source.header, np.ascontiguousarray(odds[..., :5]), depths, lattice.pinhole,
                      inside, numbers or learned_map_evidence())


def _log_odds(picture: NDArray[np.float32], lattice: PixelGrid, net: ContourNet
              ) -> NDArray[np.float32]:
    """(rows, columns, 6) of the pixels of a lattice, seen with `_CONTEXT` around them."""
    left, top = max(lattice.left - _CONTEXT, 0), max(lattice.top - _CONTEXT, 0)
    seen = picture[top:lattice.top + lattice.height + _CONTEXT,
                   left:lattice.left + lattice.width + _CONTEXT]
    odds = net(seen)
    return odds[lattice.rows[:, None] - top, lattice.columns - left]
