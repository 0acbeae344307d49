"""Draws objects on a posed view, as the liquid shows them that they may be in."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.drawing.pictures import outlines, overlay
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.sunken import as_it_appears

_DARKER = 4


def outlines_in_view(view: PosedView,
                     things: Sequence[tuple[ObjectModel, NDArray[np.float64], str]],
                     interface: Interface | None) -> NDArray[np.uint8]:
    """The `outlines` of models at poses (4, 4), each with a word; frames as `overlay_in_view`."""
    return outlines(_shown(view), view.pinhole, [
        (*_in_view(view, model, pose, interface), word) for model, pose, word in things])


def overlay_in_view(view: PosedView, model: ObjectModel, pose: NDArray[np.float64],
                    interface: Interface | None) -> NDArray[np.uint8]:
    """The `overlay` of a model at a pose (4, 4). Pose and interface: in the reference frame."""
    return overlay(_shown(view), view.pinhole, *_in_view(view, model, pose, interface))


def _shown(view: PosedView) -> NDArray[np.uint8]:
    """(height, width, 3) its picture, dark where the mask leaves it out."""
    picture = view.displayed()
    if view.mask is not None:
        picture[~view.mask] //= _DARKER
    return picture


def _in_view(view: PosedView, model: ObjectModel, pose: NDArray[np.float64],
             interface: Interface | None) -> tuple[ObjectModel, NDArray[np.float64]]:
    """The model as it appears, and its pose (4, 4), in the frame of the view's camera."""
    camera = view.camera_to_reference
    before = np.linalg.inv(camera) @ pose
    return as_it_appears(model, before, interface and interface.seen_from(camera)), before
