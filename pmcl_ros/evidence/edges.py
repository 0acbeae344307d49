"""LightField or PosedView -> EdgeVolume: structure tensor of the views refocused at each label.

A second layer behind glass biases the likelihood of the rays at a contour. The energy of an edge
that is refocused at its own depth is sharp, and stays at the edge
(docs/concepts/evidence.md).
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numba import prange
from numpy.typing import ArrayLike, NDArray

from pmcl_ros.dlv.label_segments import LabelSegments
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.planes import colour_planes, mirrored
from pmcl_ros.dlv.sampling import TAPS, copy_row, sample_row
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import (
    DepthLikelihoodVolume,
    check_values,
    checked_labels,
    depth_labels,
)
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.runtime.errors import VolumeError
from pmcl_ros.runtime.kernels import LOCK, compiled

# px: of the smoothing before the derivative. With that before the sampling (`SMOOTHER`) it is
# 0.8 px, about the resolution of the lenslets.
_SIGMA = 0.7
_REACH = 4  # px: of the smoothing's weights
NEIGHBOURHOOD = 12.0  # px: contrast is measured against that of this neighbourhood
_TILE = 336  # pixels of a row processed at once: their sums at all labels stay in the cache


@dataclass(frozen=True)
class EdgeVolume:
    """Evidence of one capture: structure tensor of the views refocused at each label.

    tensor: (height, width, labels, 3) float32, the xx, yy, xy components, in units of the local
        contrast squared.
    depths: (labels,) float64 [m], far to near, uniform in inverse depth.
    from_likelihood: made from a likelihood alone (`edges_from_likelihood`), so without directions:
        the learned contour profile does not hold for it.
    """

    header: Header
    tensor: NDArray[np.float32]
    depths: NDArray[np.float64]
    pinhole: Pinhole
    from_likelihood: bool = False

    def __post_init__(self) -> None:
        check_values(self.tensor, (3,), self.depths, self.pinhole, 'edge volume')

    def labels(self, depths: ArrayLike) -> NDArray[np.float64]:
        """(...) labels, between whole ones too, of depths (...) [m]."""
        inverse = 1 / self.depths
        return np.asarray((1 / np.asarray(depths) - inverse[0]) / (inverse[1] - inverse[0]))

    def on(self, lattice: PixelGrid) -> 'EdgeVolume':
        """The same on some of the pixels."""
        if lattice.pinhole == self.pinhole:
            return self
        tensor = np.ascontiguousarray(self.tensor[lattice.rows[:, None], lattice.columns])
        return replace(self, tensor=tensor, pinhole=lattice.pinhole)


def build_edges(light_field: LightField, settings: DlvSettings) -> EdgeVolume:
    """The edge volume of one capture, for the pixels of `PixelGrid.from_crop` the settings.

    Raises VolumeError when fewer than two views have light, the labels are too near, or the
    tensor would be too large: it is made for all pixels, whatever is kept of them.
    """
    pinhole = light_field.grid.pinhole
    lattice = PixelGrid.from_crop(pinhole, settings.crop, settings.stride)
    depths = checked_labels(light_field.grid, settings, pinhole, 'edge_labels', components=3)
    return edge_volume(light_field, depths, settings.views).on(lattice)


def view_edges(view: PosedView, settings: DlvSettings) -> EdgeVolume:
    """The edge volume of one picture, for the pixels of `PixelGrid.from_crop` the settings.

    One view knows no depth: its two labels, `far` and `near`, are alike.
    Raises VolumeError when the crop reaches out of the picture.
    """
    lattice = PixelGrid.from_crop(view.pinhole, settings.crop, settings.stride)
    alone = ViewGrid(view.pinhole, 1.0, np.zeros((1, 1, 2)), np.ones((1, 1), np.float32))
    light_field = LightField(view.header, view.linear()[None, None], alone)
    depths = depth_labels(settings.near, settings.far, 2)
    return edge_volume(light_field, depths, views=1).on(lattice)


def edge_volume(light_field: LightField, depths: NDArray[np.floating],
                views: int = 7) -> EdgeVolume:
    """The edge volume of the inner `views` x `views` views.

    depths: (labels,) [m], far to near, uniform in inverse depth.

    The views (linear, brought to the centre view's mean) are summed at each label, sampled
    between pixels by noise-neutral weights; a Gaussian's derivatives follow. The tensor is divided
    by its own mean over a neighbourhood plus its median over the image and the labels.
    Raises VolumeError when no view has light or the depths shift views out of the image.
    """
    grid = light_field.grid
    chosen = StereoPairs(grid, np.argwhere(_inner(grid, views)))
    shifts = chosen.shifts(depths)
    runs = LabelSegments.neutral(shifts)
    pad = int(np.ceil(np.abs(shifts).max())) + TAPS
    # Linear light: encoded, a blurred edge is steepest beside its place, on the darker side.
    planes, brightness = colour_planes(light_field, chosen.indices, pad, gamma=1.0)
    centre = (chosen.indices == grid.centre).all(axis=1)
    # Without a centre view (dark) the mean over the views does as well: the tensor is normalised.
    target = brightness[centre].mean() if centre.any() else brightness.mean()
    gain = target / np.maximum(brightness, 1e-6) / len(brightness)
    pinhole, count = grid.pinhole, len(depths)
    refocused = np.empty((count, 3, pinhole.height, pinhole.width), np.float32)
    tensor = np.empty((count, pinhole.height, pinhole.width, 3), np.float32)
    energy = np.empty((count, pinhole.height, pinhole.width), np.float32)
    with LOCK:
        _refocus(planes, pad, runs.where, runs.cells, runs.taps,
                 _node_weights(runs.time.astype(float)) * gain[:, None, None].astype(np.float32),
                 refocused)
        _differentiate(refocused, *_gaussian(), tensor, energy)
    around = np.stack([cv2.GaussianBlur(each, (0, 0), NEIGHBOURHOOD) for each in energy])
    normalised = np.empty((pinhole.height, pinhole.width, count, 3), np.float32)
    with LOCK:
        _normalise(tensor, around, np.float32(np.median(energy)), normalised)
    return EdgeVolume(light_field.header, normalised, np.asarray(depths, float), pinhole)


def _inner(grid: ViewGrid, views: int) -> NDArray[np.bool_]:
    """(rows, columns) mask of the inner views that have light."""
    row, column = grid.centre
    rows, columns = np.ogrid[:grid.shape[0], :grid.shape[1]]
    half = views // 2
    chosen = (abs(rows - row) <= half) & (abs(columns - column) <= half) & (grid.weights > 0)
    if not chosen.any():
        raise VolumeError(f'none of the inner {views}x{views} views has light: the pupil weights '
                          f'are {grid.weights.tolist()}')
    return chosen


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


def _node_weights(time: NDArray[np.float64]) -> NDArray[np.float32]:
    """(..., 3) Lagrange weights of a run's three nodes at `time` (...), 0 to 1."""
    return np.stack([(2 * time - 1) * (time - 1), 4 * time * (1 - time), time * (2 * time - 1)],
                    axis=-1).astype(np.float32)


def _gaussian() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(2 reach + 1,) weights of the smoothing, and of its derivative [1/px]."""
    x = np.arange(-_REACH, _REACH + 1)
    smooth = np.exp(-0.5 * (x / _SIGMA) ** 2)
    slope = x * smooth
    return ((smooth / smooth.sum()).astype(np.float32), (slope / (slope @ x)).astype(np.float32))


@compiled(parallel=True)
def _refocus(planes, pad, where, cells, taps, weights, out):  # type: ignore[no-untyped-def]
    """(labels, 3, height, width) sums of the views at every label, a row at a time."""
    labels, channels, height, width = out.shape
    tiles = -(-width // _TILE)
    length = min(-(-width // (16 * tiles)) * 16, width)  # whole vectors where there is room
    for y in prange(height):
        total = np.empty((labels, channels, _TILE), np.float32)
        nodes = np.empty((3, channels, _TILE), np.float32)
        between = np.empty(_TILE + TAPS, np.float32)
        for tile in range(tiles):
            start = min(tile * length, width - length)  # the last tile overlaps the one before
            total[:] = 0
            kept = -1  # the node whose samples are in the last of the three places
            for run in range(len(where)):
                view, label, end, node = where[run]
                for k in range(3):
                    for channel in range(channels):
                        if k == 0 and node == kept:
                            copy_row(nodes[2, channel], nodes[0, channel])
                        else:
                            sample_row(planes[view, channel], start + pad + cells[node + k, 0],
                                       y + pad + cells[node + k, 1], taps[node + k], 1, between,
                                       nodes[k, channel], length)
                kept = node + 2
                for at in range(label, end):
                    a, b, c = weights[view, at, 0], weights[view, at, 1], weights[view, at, 2]
                    for channel in range(channels):
                        _add(total[at, channel], nodes[0, channel], nodes[1, channel],
                             nodes[2, channel], a, b, c, length)
            for label in range(labels):
                for channel in range(channels):
                    copy_row(total[label, channel],
                             out[label, channel, y, start:start + length])


@compiled(inner=True)
def _add(total, first, middle, last, a, b, c, length):  # type: ignore[no-untyped-def]
    for i in range(length):
        total[i] += a * first[i] + b * middle[i] + c * last[i]


@compiled(parallel=True)
def _differentiate(pictures, smooth, slope, tensor, energy):  # type: ignore[no-untyped-def]
    """Gradient products of smoothed pictures, summed over the channels, and their trace."""
    labels, channels, height, width = pictures.shape
    reach = len(smooth) // 2
    for label in prange(labels):
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
def _normalise(tensor, around, median, out):  # type: ignore[no-untyped-def]
    """The tensor in units of the contrast around, (height, width, labels, 3)."""
    labels, height, width, _ = tensor.shape
    for y in prange(height):
        for x in range(width):
            for label in range(labels):
                scale = np.float32(1) / max(around[label, y, x] + median, np.float32(1e-12))
                for k in range(3):
                    out[y, x, label, k] = tensor[label, y, x, k] * scale
