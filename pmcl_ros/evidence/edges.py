"""LightField or PosedView -> EdgeVolume: structure tensor of the views refocused at each label.

A second layer behind glass biases the likelihood of the rays at a contour. The energy of an edge
that is refocused at its own depth is sharp, and stays at the edge
(docs/concepts/evidence.md).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.planes import mirrored
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, checked_labels, depth_labels
from pmcl_ros.evidence.binning import check_memory
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import Box, EvidenceVolume
from pmcl_ros.evidence.learned import learned_contour
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.evidence.refocusing import refocused
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.runtime.errors import VolumeError
from pmcl_ros.runtime.kernels import compiled, rounds

# px: of the smoothing before the derivative. With that before the sampling (`SMOOTHER`) it is
# 0.8 px, about the resolution of the lenslets.
_SIGMA = 0.7
_REACH = 4  # px: of the smoothing's weights
NEIGHBOURHOOD = 12.0  # px: contrast is measured against that of this neighbourhood

MakeEvidence = Callable[[], EvidenceVolume | None]


@dataclass(frozen=True)
class EdgeVolume(EvidenceVolume):
    """Evidence of one capture: structure tensor of the views refocused at each label.

    tensor: (height, width, labels, 3) float32, the xx, yy, xy components, in units of the local
        contrast squared. Its reading is the edge energy across a normal.
    from_likelihood: made from a likelihood alone (`edges_from_likelihood`), so without directions:
        the learned contour profile does not hold for it.
    other: makes other evidence of the same capture, if there is any, or None: it is searched too
        where edges lose the object or are unsure of it.
    """

    from_likelihood: bool = False
    other: MakeEvidence | None = field(default=None, repr=False, compare=False)

    components: ClassVar[int] = 3
    kind: ClassVar[str] = 'edge volume'

    @property
    def profile(self) -> ContourProfile:
        """The learned one; the contrast for edges made from a likelihood."""
        return ContourProfile.contrast() if self.from_likelihood else ContourProfile.learned()

    @property
    def least_support(self) -> float:
        """See `EvidenceVolume`."""
        return learned_contour().least_support

    @property
    def model_error(self) -> ModelError:
        """See `EvidenceVolume`."""
        return ModelError.learned()

    @property
    def shows_creases(self) -> bool:
        """See `EvidenceVolume`."""
        return not self.from_likelihood

    def suppressed(self, kept: NDArray[np.float32]) -> 'EdgeVolume':
        """See `EvidenceVolume`. The tensor holds squared energies."""
        return replace(self, tensor=self.tensor * (kept ** 2)[..., None, None])

    def blurred(self, sigma: float, box: Box | None = None) -> 'EdgeVolume':  # noqa: ARG002
        """Itself: edge energy is smooth already."""
        return self


def build_edges(light_field: LightField, settings: DlvSettings) -> EdgeVolume:
    """The edge volume of one capture, for the pixels of `PixelGrid.from_crop` the settings.

    Raises VolumeError when fewer than two views have light, the labels are too near, or the
    tensor would be too large: it is made for all pixels, whatever is kept of them.
    """
    pinhole = light_field.grid.pinhole
    lattice = PixelGrid.from_crop(pinhole, settings.crop, settings.stride)
    pairs = StereoPairs.from_grid(light_field.grid, settings.views)
    depths = checked_labels(pairs, settings, pinhole, 'edge_labels', components=3)
    return edge_volume(light_field, depths, settings.views).on(lattice)


def view_edges(view: PosedView, settings: DlvSettings) -> EdgeVolume:
    """The edge volume of one picture, for the pixels of `PixelGrid.from_crop` the settings.

    One view knows no depth: its two labels, `far` and `near`, are alike.
    Raises VolumeError when the crop reaches out of the picture, the picture is too large, or it
    has a mask: where edges have no energy, they speak against a contour.
    """
    if view.mask is not None:
        raise VolumeError(f'{view.name or "the picture"} has a mask, which edges cannot leave '
                          'out: search in the contour map (evidence map)')
    check_memory(PixelGrid.from_crop(view.pinhole, (0, 0, 0, 0), 1), 2)
    lattice = PixelGrid.from_crop(view.pinhole, settings.crop, settings.stride)
    light_field = LightField.of_one_view(view.header, view.linear(), view.pinhole)
    depths = depth_labels(settings.near, settings.far, 2)
    return edge_volume(light_field, depths, views=1).on(lattice)


def edge_volume(light_field: LightField, depths: NDArray[np.floating],
                views: int = 7) -> EdgeVolume:
    """The edge volume of the inner `views` x `views` views.

    depths: (labels,) [m], far to near, uniform in inverse depth.

    A Gaussian's derivatives of the refocused pictures are divided by their own mean square over a
    neighbourhood plus its median over the image and the labels. Raises as `refocused`.
    """
    pictures = refocused(light_field, depths, views)
    pinhole, count = light_field.grid.pinhole, len(depths)
    tensor = np.empty((count, pinhole.height, pinhole.width, 3), np.float32)
    energy = np.empty((count, pinhole.height, pinhole.width), np.float32)
    _differentiate(pictures, *_gaussian(), tensor, energy)
    del pictures  # they are as large as the tensor
    around = np.empty_like(energy)
    for number, each in enumerate(energy):
        around[number] = cv2.GaussianBlur(each, (0, 0), NEIGHBOURHOOD)
    normalised = np.empty((pinhole.height, pinhole.width, count, 3), np.float32)
    _normalise(tensor, around, np.float32(np.median(energy)), normalised)
    return EdgeVolume(light_field.header, normalised, np.asarray(depths, float), pinhole)


def edges_from_likelihood(volume: DepthLikelihoodVolume, labels: int = 25) -> EdgeVolume:
    """An edge volume from a likelihood alone, where nothing else was recorded.

    The likelihood exceeds its mean over the labels at edges, most at their depth. The square of
    the excess, divided by its mean over the neighbourhood, replaces the edge energy. It has no
    directions and the resolution of the window R_x: the contour evidence is about half of that
    from refocused edges.
    labels: the largest number of labels, about; they are chosen evenly.
    """
    step = max(1, round(len(volume.depths) / labels))
    likelihood = volume.likelihood[:, :, ::step]
    likelihood = np.maximum(likelihood - likelihood.mean(axis=2, keepdims=True), 0)
    mean = likelihood.mean(axis=2)
    around = cv2.GaussianBlur(mean, (0, 0), NEIGHBOURHOOD) + np.median(mean)
    energy = (likelihood / np.maximum(around, 1e-12)[..., None]) ** 2
    tensor = np.zeros((*energy.shape, 3), np.float32)
    tensor[..., 0] = tensor[..., 1] = energy
    return EdgeVolume(volume.header, tensor, volume.depths[::step], volume.pinhole,
                      from_likelihood=True)


def _gaussian() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(2 reach + 1,) weights of the smoothing, and of its derivative [1/px]."""
    x = np.arange(-_REACH, _REACH + 1)
    smooth = np.exp(-0.5 * (x / _SIGMA) ** 2)
    slope = x * smooth
    return ((smooth / smooth.sum()).astype(np.float32), (slope / (slope @ x)).astype(np.float32))


@compiled(parallel=True)
def _differentiate(pictures, smooth, slope, tensor, energy, portion):  # type: ignore[no-untyped-def]
    """Gradient products of smoothed pictures, summed over the channels, and their trace."""
    labels, channels, height, width = pictures.shape
    reach = len(smooth) // 2
    for label in rounds(labels, portion):
        down = np.empty(width + 2 * reach, np.float32)
        level = np.empty(width + 2 * reach, np.float32)
        sums = np.empty((3, width), np.float32)
        for y in range(height):
            sums[:] = 0
            for channel in range(channels):
                _vertical(pictures[label, channel], y, smooth, slope, level, down)
                _products(level, down, smooth, slope, sums)
            xx, yy, xy = sums[0], sums[1], sums[2]
            for x in range(width):
                tensor[label, y, x, 0], tensor[label, y, x, 1] = xx[x], yy[x]
                tensor[label, y, x, 2] = xy[x]
                energy[label, y, x] = xx[x] + yy[x]


@compiled(inner=True)
def _vertical(picture, y, smooth, slope, level, down):  # type: ignore[no-untyped-def]
    """A row smoothed and differentiated along y; outside are the mirrored borders."""
    height, width = picture.shape
    reach = len(smooth) // 2
    level[:] = 0
    down[:] = 0
    inside, steep = level[reach:reach + width], down[reach:reach + width]
    for k in range(len(smooth)):
        row, a, b = picture[mirrored(y + k - reach, height)], smooth[k], slope[k]
        for x in range(width):
            inside[x] += a * row[x]
            steep[x] += b * row[x]
    for k in range(reach):
        before, after = mirrored(k - reach, width), mirrored(width + k, width)
        level[k], level[reach + width + k] = inside[before], inside[after]
        down[k], down[reach + width + k] = steep[before], steep[after]


@compiled(inner=True)
def _products(level, down, smooth, slope, sums):  # type: ignore[no-untyped-def]
    xx, yy, xy = sums[0], sums[1], sums[2]
    for x in range(len(xx)):
        gx = gy = np.float32(0)
        for k in range(2 * _REACH + 1):
            gx += slope[k] * level[x + k]
            gy += smooth[k] * down[x + k]
        xx[x] += gx * gx
        yy[x] += gy * gy
        xy[x] += gx * gy


@compiled(parallel=True)
def _normalise(tensor, around, median, out, portion):  # type: ignore[no-untyped-def]
    """The tensor in units of the contrast around, (height, width, labels, 3)."""
    labels, height, width, _ = tensor.shape
    for y in rounds(height, portion):
        for x in range(width):
            for label in range(labels):
                scale = np.float32(1) / max(around[label, y, x] + median, np.float32(1e-12))
                for k in range(3):
                    out[y, x, label, k] = tensor[label, y, x, k] * scale
