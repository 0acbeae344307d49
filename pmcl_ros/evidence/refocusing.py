"""Refocuses the views of a light field at depths."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.label_segments import LabelSegments
from pmcl_ros.dlv.pairs import StereoPairs, inner_views
from pmcl_ros.dlv.planes import colour_planes
from pmcl_ros.dlv.sampling import TAPS, copy_row, sample_row
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import VolumeError
from pmcl_ros.runtime.kernels import compiled, rounds

_TILE = 336  # pixels of a row processed at once: their sums at all labels stay in the cache


def refocused(light_field: LightField, depths: NDArray[np.floating], views: int
              ) -> NDArray[np.float32]:
    """(labels, 3, height, width) linear RGB: the mean of the views, refocused at each depth.

    depths: (labels,) [m], far to near, uniform in inverse depth. views: side of the square of
    inner views that are used.

    The views, brought to the centre view's mean, are sampled between pixels by noise-neutral
    weights. Raises VolumeError when no view has light or the depths shift views out of the image.
    """
    grid = light_field.grid
    chosen = StereoPairs(grid, np.argwhere(inner_views(grid, views)))
    if not len(chosen.indices):
        raise VolumeError(f'none of the inner {views}x{views} views has light: the pupil weights '
                          f'are {grid.weights.tolist()}')
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
    pictures = np.empty((count, 3, pinhole.height, pinhole.width), np.float32)
    _refocus(planes, pad, runs.where, runs.cells, runs.taps,
             _node_weights(runs.time.astype(float)) * gain[:, None, None].astype(np.float32),
             pictures)
    return pictures


def _node_weights(time: NDArray[np.float64]) -> NDArray[np.float32]:
    """(..., 3) Lagrange weights of a run's three nodes at `time` (...), 0 to 1."""
    return np.stack([(2 * time - 1) * (time - 1), 4 * time * (1 - time), time * (2 * time - 1)],
                    axis=-1).astype(np.float32)


@compiled(parallel=True)
def _refocus(planes, pad, where, cells, taps, weights, out, portion):  # type: ignore[no-untyped-def]
    """(labels, 3, height, width) sums of the views at every label, a row at a time."""
    labels, channels, height, width = out.shape
    tiles = -(-width // _TILE)
    length = min(-(-width // (16 * tiles)) * 16, width)  # whole vectors where there is room
    for y in rounds(height, portion):
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
