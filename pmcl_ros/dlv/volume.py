"""The third of the four values: how likely light on a pixel came from each depth."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.layers import Layers, read_layers
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.superposition import Superposition
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import VolumeError


def depth_labels(near: float, far: float, count: int) -> NDArray[np.float64]:
    """`count` depths [m] from far to near, uniform in inverse depth (paper, section VI)."""
    if not 0 < near < far < np.inf or count < 2:
        raise VolumeError(f'{count} labels from {near} m to {far} m: need 0 < near < far and two '
                          'labels or more')
    return 1 / np.linspace(1 / far, 1 / near, count)


def _check(values: NDArray[np.float32], components: tuple[int, ...], depths: NDArray[np.float64],
           pinhole: Pinhole, name: str) -> None:
    expected = (pinhole.height, pinhole.width, len(depths), *components)
    if values.shape != expected:
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
class EdgeVolume:
    """Structure tensor of the views refocused at each label: where edges lie at that depth.

    tensor: (height, width, labels, 3) float32, the xx, yy, xy components, in units of the local
        contrast squared.
    depths: (labels,) float64 [m], far to near, uniform in inverse depth.
    """

    header: Header
    tensor: NDArray[np.float32]
    depths: NDArray[np.float64]
    pinhole: Pinhole

    def __post_init__(self) -> None:
        _check(self.tensor, (3,), self.depths, self.pinhole, 'edge volume')

    def on(self, lattice: PixelGrid) -> 'EdgeVolume':
        """The same on some of the pixels."""
        if lattice.pinhole == self.pinhole:
            return self
        tensor = np.ascontiguousarray(self.tensor[lattice.rows[:, None], lattice.columns])
        return replace(self, tensor=tensor, pinhole=lattice.pinhole)


@dataclass(frozen=True)
class DepthLikelihoodVolume:
    """The paper's DLV (section IV), in the centre view.

    likelihood: (height, width, labels) float32, the log of eq. "L(x, l)": zero at the worst label
        of a pixel, growing.
    depths: (labels,) float64 [m], far to near, uniform in inverse depth.
    edges: the edge volume of the same capture, where it was made.
    superposition: two layers fitted to each of its rays, where that was asked for.
    """

    header: Header
    likelihood: NDArray[np.float32]
    depths: NDArray[np.float64]
    pinhole: Pinhole
    edges: EdgeVolume | None = None
    superposition: Superposition | None = None

    def __post_init__(self) -> None:
        _check(self.likelihood, (), self.depths, self.pinhole, 'volume')

    def layers(self, count: int = 2, prominence: float = 0.1) -> Layers:
        """The most likely distinct surfaces along each ray (`read_layers`).

        A ray's only one is two where the superposition says so.
        """
        layers = read_layers(self.likelihood, self.depths, count, prominence)
        if self.superposition is None or count < 2:
            return layers
        return self.superposition.split(layers)

    def depth_map(self) -> NDArray[np.float32]:
        """(height, width) the most likely depth of each pixel [m], between the labels.

        NaN where all labels are alike.
        """
        return self.layers(1, 0).depths[..., 0]
