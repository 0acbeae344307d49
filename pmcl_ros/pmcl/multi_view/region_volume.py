"""ViewsEvidence -> DepthLikelihoodVolume of the part of a view that can show the object."""

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.plane_sweep import build_volume_of_views
from pmcl_ros.dlv.posed_pairs import PosedPairs, central
from pmcl_ros.dlv.settings import MOST_LABELS, DlvSettings, within_limits
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.pmcl.multi_view.joint_evidence import regions_seen
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.scene import Window
from pmcl_ros.pmcl.settings import PmclSettings

_LOG = logging.getLogger(__name__)
_MOST_VALUES = 2 ** 26  # a quarter of a GiB


def region_volume(evidence: ViewsEvidence, model: ObjectModel, settings: PmclSettings,
                  changes: Mapping[str, Any] | None = None, origin: str = 'region of interest',
                  beyond: float = 0.0, pose: NDArray[np.float64] | None = None
                  ) -> tuple[DepthLikelihoodVolume, DlvSettings] | None:
    """The volume in the central one of the views that see the region of interest; its settings.

    It has as many labels as by default, or more where the views move farther, up to a quarter of a
    GiB. None where one view alone sees the region, or the evidence is without its pictures.
    changes: values that are wanted otherwise. origin: of them, for errors (SettingsError). beyond:
    by how much the labels reach farther than the region [m]. pose: (4, 4) of the object in the
    reference frame, where only pixels that show it there are of interest.
    Raises VolumeError, and LocalizationError where no view sees the region.
    """
    views = evidence.pictures
    if views is None:
        return None
    seen = regions_seen(evidence, model, settings)
    if len(seen) < 2:
        _LOG.info('one view alone sees the region of interest: it has no depth likelihood volume')
        return None
    number = list(seen)[central(PosedViews(tuple(views.views[each] for each in seen)))]
    near, far = seen[number].grown(model.radius)
    window = seen[number].window(views.views[number].pinhole, model.radius)
    if pose is not None:
        window = _about(model, pose, views.views[number], window)
    values: dict[str, Any] = {**within_limits(max(near - beyond, near / 2), far + beyond),
                              'crop': (window.left, window.top, *window.size)}
    made = DlvSettings.make(values | dict(changes or {}), origin)
    chosen = 'labels' in (changes or {})
    if not chosen:
        pairs = PosedPairs.from_views(views, made.crop, made.stride, number)
        rows, columns = pairs.pixels.shape
        labels = min(max(made.labels, pairs.labels_needed(made.near, made.far)), MOST_LABELS,
                     _MOST_VALUES // (rows * columns))
        made = made.model_copy(update={'labels': labels})
    # A warning is of what the user chose: otherwise there are as many as are possible.
    level = logging.WARNING if chosen else logging.INFO
    return build_volume_of_views(views, made, number, level), made


def _about(model: ObjectModel, pose: NDArray[np.float64], view: PosedView, window: Window
           ) -> Window:
    """The part of a window that shows a pose (4, 4), in the reference frame.

    All of it where a part of the object is behind the camera.
    """
    seen = np.linalg.inv(view.camera_to_reference) @ pose
    pixels = view.pinhole.project(model.vertices @ seen[:3, :3].T + seen[:3, 3])
    if not np.isfinite(pixels).all():
        return window
    corner = np.array([window.left, window.top])
    low = np.clip(np.floor(pixels.min(axis=0)) - corner, 0, np.array(window.size) - 1)
    high = np.clip(np.ceil(pixels.max(axis=0)) + 1 - corner, low + 1, window.size)
    (left, top), (width, height) = (low + corner).astype(int), (high - low).astype(int)
    return Window(int(left), int(top), (int(width), int(height)))
