"""DepthLikelihoodVolume: the likelihood of each depth at each pixel (paper, section IV)."""

import logging
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.layers import Layers, read_layers
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.posed_pairs import PosedPairs
from pmcl_ros.dlv.settings import MOST_LABELS, DlvSettings
from pmcl_ros.dlv.superposition import Superposition
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import check_pose
from pmcl_ros.runtime.errors import VolumeError

_LOG = logging.getLogger(__name__)
_MOST_BYTES = 3 * 2 ** 30  # of a volume and what it is made of
_BYTES, _PHASE_BYTES = 12, 33  # of a value while it is made


def depth_labels(near: float, far: float, count: int) -> NDArray[np.float64]:
    """`count` depths [m] from far to near, uniform in inverse depth (paper, section VI)."""
    if not 0 < near < far < np.inf or count < 2:
        raise VolumeError(f'{count} labels from {near} m to {far} m: need 0 < near < far and two '
                          'labels or more')
    return 1 / np.linspace(1 / far, 1 / near, count)


def checked_labels(pairs: StereoPairs | PosedPairs, settings: DlvSettings, pinhole: Pinhole,
                   name: Literal['labels', 'edge_labels'], components: int = 1,
                   level: int = logging.WARNING) -> NDArray[np.float64]:
    """The depths (labels,) [m] of the labels that the settings ask for.

    pinhole: of the pixels that each get `components` float32 values a label. Raises VolumeError
    where the values take too much memory. Logs, at a level, where views move by more than a pixel
    from label to label.
    """
    count = getattr(settings, name)
    is_phase = settings.interpolation == 'phase' and name == 'labels'  # in double precision
    size = pinhole.height * pinhole.width * count * components * (
        _PHASE_BYTES if is_phase else _BYTES)
    if size > _MOST_BYTES:
        raise VolumeError(
            f'{count} {name} of {pinhole.width}x{pinhole.height} px need {size / 2 ** 30:.1f} GiB,'
            f' more than {_MOST_BYTES / 2 ** 30:.0f}: choose fewer {name}, or make '
            f'pixels {math.ceil(math.sqrt(size / _MOST_BYTES))} times as large (--shrink)')
    needed = pairs.labels_needed(settings.near, settings.far)
    if count < needed:
        _tell_few_labels(level, name, count, needed)
    return depth_labels(settings.near, settings.far, count)


@lru_cache(maxsize=16)  # logged once, not at every capture
def _tell_few_labels(level: int, name: str, count: int, needed: int) -> None:
    more = (f'set {name} to {needed} (it is {count})' if needed <= MOST_LABELS
            else 'make pixels larger')
    _LOG.log(level, 'views move by up to %.1f px from label to label, more than one: %s, or near '
             'and far closer together', (needed - 1) / (count - 1), more)


def check_values(values: NDArray[np.float32], components: tuple[int, ...],
                 depths: NDArray[np.float64], pinhole: Pinhole, name: str, shared: bool = False
                 ) -> None:
    """Raise VolumeError unless values are finite, one for each pixel and label (and component).

    values: (height, width, labels, *components). depths: (labels,) [m], far to near, uniform in
    inverse depth. name: for the message. shared: one label may stand for all.
    """
    expected = (pinhole.height, pinhole.width, len(depths), *components)
    if values.shape != expected and not (
            shared and values.shape == (*expected[:2], 1, *components)):
        raise VolumeError(f'{name} has shape {values.shape}, expected {expected}: height, width, '
                          'labels')
    if len(depths) < 2 or not (np.isfinite(depths).all() and (depths > 0).all()):
        raise VolumeError(f'depth labels of {name} must be at least two positive finite numbers, '
                          f'got {depths}')
    steps = np.diff(1 / depths)
    if (steps <= 0).any() or np.ptp(steps) > 1e-3 * steps.mean():
        raise VolumeError(f'depth labels of {name} must run from far to near, uniform in inverse '
                          f'depth, got {depths}')
    if not np.isfinite(values).all():
        raise VolumeError(f'{name} holds NaN or infinity; every value must be finite')


@dataclass(frozen=True)
class CameraPose:
    """Where the camera of a volume is.

    frame_id: the reference frame. camera_to_reference: (4, 4) pose of the camera's optical frame
    in it [m]. Raises LightFieldError where that is no pose.
    """

    frame_id: str
    camera_to_reference: NDArray[np.float64]

    def __post_init__(self) -> None:
        check_pose(self.camera_to_reference, 'camera_to_reference')


@dataclass(frozen=True)
class DepthLikelihoodVolume:
    """The paper's DLV (section IV), in the centre view, or in one of several posed views.

    header: frame_id is the optical frame of the camera whose pixels these are.

    likelihood: (height, width, labels) float32, the log of eq. "L(x, l)": zero at the worst label
        of a pixel, growing.
    depths: (labels,) float64 [m], far to near, uniform in inverse depth.
    superposition: two layers fitted to each of its rays, where that was asked for.
    camera: where that camera is, of posed views; None: the frame's name alone says it.
    """

    header: Header
    likelihood: NDArray[np.float32]
    depths: NDArray[np.float64]
    pinhole: Pinhole
    superposition: Superposition | None = None
    camera: CameraPose | None = None

    def __post_init__(self) -> None:
        check_values(self.likelihood, (), self.depths, self.pinhole, 'volume')

    def layers(self, count: int = 2, prominence: float = 0.1) -> Layers:
        """The most likely distinct surfaces along each ray (`read_layers`).

        Splits a single layer where the joint fit prefers two.
        """
        layers = read_layers(self.likelihood, self.depths, count, prominence)
        if self.superposition is None or count < 2:
            return layers
        return self.superposition.split(layers)

    def depth_map(self) -> NDArray[np.float32]:
        """(height, width) the most likely depth of each pixel [m], between the labels.

        NaN where all labels are equally likely.
        """
        return self.layers(1, 0).depths[..., 0]
