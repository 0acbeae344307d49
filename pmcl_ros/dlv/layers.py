"""The surfaces along each ray: where a likelihood has its maxima."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.likelihood import peaks
from pmcl_ros.runtime.kernels import compiled, rounds


@dataclass(frozen=True)
class Layers:
    """Surfaces along each ray, the most likely first; NaN where there are no more.

    depths: (height, width, surfaces) float32 [m], between the labels.
    likelihood: (height, width, surfaces) float32, the volume's at that depth.
    sharpness: (height, width, surfaces) float32, how fast it falls on both sides: minus its second
        difference [1/label^2]; 0 at the first and the last label, whose surface may lie beyond.
    """

    depths: NDArray[np.float32]
    likelihood: NDArray[np.float32]
    sharpness: NDArray[np.float32]

    @property
    def front(self) -> NDArray[np.float32]:
        """(height, width) depth of the nearest surface of each ray [m]; NaN: there is none."""
        return np.fmin.reduce(self.depths, axis=2)

    @property
    def behind(self) -> NDArray[np.float32]:
        """(height, width) depth of the farthest surface of each ray [m], where it has several."""
        several = np.isfinite(self.depths).sum(axis=2) > 1
        return np.where(several, np.fmax.reduce(self.depths, axis=2), np.float32(np.nan))


def read_layers(likelihood: NDArray[np.float32], depths: NDArray[np.float64], count: int = 2,
                prominence: float = 0.1) -> Layers:
    """The `count` most likely distinct surfaces along each ray.

    likelihood: (height, width, labels) float32. depths: (labels,) [m], uniform in inverse depth.
    A surface is a local maximum that rises by more than `prominence` times the ray's highest value
    above the valley between it and any higher one. Its place is that of the parabola through the
    maximum and its neighbours, half-way along a plateau. A ray whose likelihoods are all 0 has
    none.
    """
    height, width, labels = likelihood.shape
    found = np.empty((height, width, count, 3), np.float32)
    _read(np.ascontiguousarray(likelihood, np.float32), float(prominence), found)
    inverse = 1 / np.asarray(depths, float)
    place = found[..., 0].astype(float)
    metres = 1 / (inverse[0] + place * (inverse[-1] - inverse[0]) / (labels - 1))
    return Layers(metres.astype(np.float32), found[..., 1], found[..., 2])


@compiled(parallel=True)
def _read(likelihood, prominence, found, portion):  # type: ignore[no-untyped-def]
    """Writes place [labels], height and sharpness of each surface."""
    height, width, labels = likelihood.shape
    for y in rounds(height, portion):
        ends = np.empty((labels, 2), np.int64)
        heights = np.empty(labels, np.float32)
        for x in range(width):
            ray = likelihood[y, x]
            found[y, x] = np.nan
            count = _prominent_peaks(ray, prominence, ends, heights)
            for surface in range(min(len(found[y, x]), count)):
                best = np.argmax(heights[:count])
                _describe(ray, ends[best, 0], ends[best, 1], found[y, x, surface])
                heights[best] = -1


@compiled(inner=True)
def _prominent_peaks(ray, prominence, ends, heights):  # type: ignore[no-untyped-def]
    """As `peaks`, of those that rise far enough above the valleys."""
    found, kept = peaks(ray, ends, heights), 0
    most = np.float32(0)
    for k in range(found):
        most = max(most, heights[k])
    for k in range(found):
        first, last, height = ends[k, 0], ends[k, 1], heights[k]
        if height - max(_valley(ray, first, -1), _valley(ray, last, 1)) > prominence * most:
            ends[kept, 0], ends[kept, 1], heights[kept] = first, last, height
            kept += 1
    return kept


@compiled(inner=True)
def _valley(ray, label, step):  # type: ignore[no-untyped-def]
    """The lowest value from a maximum on until the ray is higher; 0 if it never is.

    Of equally high maxima the first has no higher one.
    """
    lowest, at = ray[label], label + step
    while 0 <= at < len(ray):
        if ray[at] > ray[label] or (ray[at] == ray[label] and step < 0):
            return lowest
        lowest = min(lowest, ray[at])
        at += step
    return np.float32(0)


@compiled(inner=True)
def _describe(ray, first, last, out):  # type: ignore[no-untyped-def]
    if first == 0 or last == len(ray) - 1 or last - first > 1:
        at = first if first == 0 else last if last == len(ray) - 1 else (first + last) / 2
        out[0], out[1], out[2] = at, ray[first], 0
        return
    if first < last:  # half-way between two labels
        bend = ray[first] - (ray[first - 1] + ray[last + 1]) / 2
        out[0], out[1], out[2] = (first + last) / 2, ray[first] + bend / 8, bend
        return
    before, here, after = ray[first - 1], ray[first], ray[first + 1]
    bend = 2 * here - before - after
    slope = (after - before) / 2
    out[0], out[1], out[2] = first + slope / bend, here + slope * slope / (2 * bend), bend
