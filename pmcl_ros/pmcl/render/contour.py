"""z-buffer, edges or contour map -> evidence along the occluding contour: the kernels.

A contour runs between two neighbouring pixels of which one is nearer by the fraction `jump` or
more, or covered where the other is not. Each such pair is a point of the contour.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.evidence.learned import MOST_KNOTS, MOST_OFFSETS
from pmcl_ros.pmcl.render.raster import MARGIN
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.kernels import borrowed, compiled

_JUMP = 0.2  # of the object's radius: what counts as an occlusion
_LARGEST_JUMP = 0.5  # relative, of 1/z; from 1 on nothing would be an occlusion (`jump_of`)
_FALL = 0.35  # of the weights of neighbours for the normal: exp(-0.35 d^2)


class KernelVolume(NamedTuple):
    """An evidence volume and a profile as kernels take them.

    tensor: (height, width, labels, 3 or 5) float32, as of an EdgeVolume or a ContourMap.
    region: (height, width, labels) float32 evidence of covered pixels [nat / px]; empty: none.
        Both have one label where all are the same.
    left, top, scale: of the z-buffer in them [image px].
    farthest: 1 / depth of label 0 [1/m]. per_closeness: labels per 1/m.
    keep: a pixel is beyond another if its 1/z is less than this times the other's.
    merged: a contour inside the outline that is so near to it is one with it [pixels of the
        z-buffer].
    offsets: (j,) from the contour [image px]. knots, widths: (k,) where ramps begin and how long
        they are [1]. slopes: (j, k) of the evidence in them [nat / px]. bias: [nat / px].
    """

    tensor: NDArray[np.float32]
    region: NDArray[np.float32]
    left: int
    top: int
    scale: int
    farthest: float
    per_closeness: float
    keep: np.float32
    merged: int
    offsets: NDArray[np.float32]
    knots: NDArray[np.float32]
    widths: NDArray[np.float32]
    slopes: NDArray[np.float32]
    bias: np.float32

    @classmethod
    def from_volume(cls, scene: Scene, volume: EvidenceVolume, profile: ContourProfile
                    ) -> 'KernelVolume':
        """As a scene's contours are judged by."""
        window = scene.window
        farthest, per_closeness = label_scale(volume.depths)
        widths = np.diff(profile.knots)
        return cls(np.ascontiguousarray(volume.tensor, np.float32),
                   np.ascontiguousarray(volume.region, np.float32), window.left, window.top,
                   window.scale, farthest, per_closeness, np.float32(1 - jump_of(scene, volume)),
                   math.ceil(volume.resolution / window.scale),
                   profile.offsets.astype(np.float32), profile.knots[:-1].astype(np.float32),
                   widths.astype(np.float32),
                   (np.diff(profile.tables) / widths).astype(np.float32),
                   np.float32(profile.bias + profile.tables[:, 0].sum()))


def label_scale(depths: NDArray[np.float64]) -> tuple[float, float]:
    """1 / depth of label 0 [1/m], and labels per 1/m, of labels uniform in inverse depth."""
    inverse = 1 / depths
    return float(inverse[0]), float((len(inverse) - 1) / (inverse[-1] - inverse[0]))


def jump_of(scene: Scene, volume: EvidenceVolume) -> float:
    """The relative difference in 1/z that counts as an occlusion [1].

    It is limited: the mean of 1/z has no bound where labels begin at the camera, and from 1 on
    even the outline would be no occlusion.
    """
    return min(float(_JUMP * scene.model.radius * (1 / volume.depths).mean()), _LARGEST_JUMP)


def check_profile(profile: ContourProfile) -> None:
    """Raise RenderError for a profile larger than scores are made for."""
    offsets, knots = profile.tables.shape
    if offsets > MOST_OFFSETS or not 2 <= knots <= MOST_KNOTS:
        raise RenderError(f'a contour profile of {offsets} offsets and {knots} knots: scores take '
                          f'{MOST_OFFSETS} offsets at most and 2 to {MOST_KNOTS} knots')


@compiled(inlined=True)
def find(box, keep, merged, z, found):  # type: ignore[no-untyped-def]
    """Write the pairs of pixels on the contour to `found`; returns how many.

    A pair inside the outline is left out where the outline is within `merged` pixels beyond it:
    a picture shows such two contours as one, whose evidence must not count twice.

    4 times the index of the pair's first pixel, 2 if the other is below it, not beside it, 1 if
    the other is the nearer.
    """
    left, top, right, bottom = box
    stride = right - left + 2 * MARGIN
    count = 0
    if left >= right:
        return count
    for row in range(MARGIN - 1, bottom - top + MARGIN):
        begin = row * stride
        here, below = z[begin:begin + stride], z[begin + stride:begin + 2 * stride]
        for k in range(MARGIN - 1, right - left + MARGIN):
            a = here[k]
            b = here[k + 1]
            if _across(a, b, keep) and not _is_merged(a, b, begin + k, 1, merged, z):
                found[count] = 4 * (begin + k) + (1 if b > a else 0)
                count += 1
            b = below[k]
            if _across(a, b, keep) and not _is_merged(a, b, begin + k, stride, merged, z):
                found[count] = 4 * (begin + k) + 2 + (1 if b > a else 0)
                count += 1
    return count


@compiled(inlined=True, inner=True)
def _across(a, b, keep):  # type: ignore[no-untyped-def]
    """Whether a contour runs between two pixels."""
    least, most = (a, b) if a < b else (b, a)
    return (least < most * keep) & (least >= 0)


@compiled(inlined=True, inner=True)
def _is_merged(a, b, first, step, merged, z):  # type: ignore[no-untyped-def]
    """Whether the outline is within `merged` pixels beyond a pair inside it."""
    if a == 0 or b == 0:
        return False
    at, step = (first, -step) if b > a else (first + step, step)
    for _ in range(merged):
        at += step
        if z[at] <= 0:
            return z[at] == 0
    return False


@compiled(inlined=True, inner=True)
def normal(near, stride, keep, z):  # type: ignore[no-untyped-def]
    """The normal out of the surface at a pixel: unit x and y, or zeros where there is none.

    It points from the centre of the nearer surface within 5x5 pixels to the centre of the rest.
    """
    limit = z[near] * keep
    x, y = np.float32(0), np.float32(0)
    for row in range(-2, 3):
        line = z[near + row * stride - 2:near + row * stride + 3]
        for column in range(5):
            other = line[column]
            across = np.float32(column - 2)
            weight = _WEIGHTS[row + 2, column] if (other >= 0) & (other < limit) else np.float32(0)
            x += weight * across
            y += weight * np.float32(row)
    square = x * x + y * y
    if square < 1e-6:
        return np.float32(0), np.float32(0)
    one = np.float32(1) / np.sqrt(square)
    return x * one, y * one


_WEIGHTS = np.exp(-_FALL * np.add.outer(np.arange(-2, 3) ** 2, np.arange(-2, 3) ** 2)
                  ).astype(np.float32)


@compiled(inlined=True, inner=True)
def sample(tensor, x, y, label, nx, ny):  # type: ignore[no-untyped-def]
    """A tensor at a place for a normal, interpolated; beyond it that of its end.

    It is the edge energy across the normal, or the log odds of a ContourMap.
    """
    tensor = borrowed(tensor)
    height, width, labels, components = tensor.shape
    x = min(max(x, np.float32(0)), np.float32(width - 1))
    y = min(max(y, np.float32(0)), np.float32(height - 1))
    label = min(max(label, np.float32(0)), np.float32(labels - 1))
    column, row, level = int(x), int(y), max(min(int(label), labels - 2), 0)
    fx, fy, fl = x - np.float32(column), y - np.float32(row), label - np.float32(level)
    right, below = min(column + 1, width - 1), min(row + 1, height - 1)
    c2, s2 = nx * nx - ny * ny, np.float32(2) * nx * ny
    odds, xx, yy, xy = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for j in range(2):
        line = tensor[below if j else row]
        down = fy if j else np.float32(1) - fy
        for i in range(2):
            ray = line[right if i else column]
            part = down * (fx if i else np.float32(1) - fx)
            for k in range(min(labels, 2)):
                share = part * (fl if k else np.float32(1) - fl)
                each = ray[level + k]
                if components == 5:
                    odds += share * (each[0] + each[1] * nx + each[2] * ny + each[3] * c2
                                     + each[4] * s2)
                else:
                    xx += share * each[0]
                    yy += share * each[1]
                    xy += share * each[2]
    if components == 5:
        return odds
    square = xx * nx * nx + yy * ny * ny + np.float32(2) * xy * nx * ny
    return np.sqrt(max(square, np.float32(0)))


@compiled(inlined=True, inner=True)
def region_at(region, x, y, label):  # type: ignore[no-untyped-def]
    """Evidence of a covered pixel at the nearest place and label [nat / px]; beyond it: 0."""
    height, width, labels = region.shape
    column, row = int(x + np.float32(0.5)), int(y + np.float32(0.5))
    if x < 0 or y < 0 or column >= width or row >= height:
        return np.float32(0)
    level = min(max(int(label + np.float32(0.5)), 0), labels - 1)
    return region[row, column, level]


@compiled(inlined=True, inner=True)
def region_sum(box, z, volume):  # type: ignore[no-untyped-def]
    """Evidence of the pixels that a z-buffer covers [nat]."""
    total = 0.0
    if volume.region.shape[0] == 0:
        return total
    scale = volume.scale
    half = 0.5 * (scale - 1)
    stride = box[2] - box[0] + 2 * MARGIN
    for row in range(box[3] - box[1]):
        y = volume.top + scale * (box[1] + row) + half
        first = (row + MARGIN) * stride + MARGIN
        for k in range(box[2] - box[0]):
            closeness = z[first + k]
            if closeness > 0:
                x = volume.left + scale * (box[0] + k) + half
                label = np.float32((closeness - volume.farthest) * volume.per_closeness)
                total += region_at(volume.region, np.float32(x), np.float32(y), label)
    return total * scale * scale


@compiled(inlined=True, inner=True)
def place(code, box, window, z):  # type: ignore[no-untyped-def]
    """Of a pair: its nearer pixel's index, x and y between the two in the image, its 1/z."""
    left, top, right, _ = box
    stride = right - left + 2 * MARGIN
    first = code >> 2
    below = (code >> 1) & 1
    near = first + (stride if below else 1) * (code & 1)
    row = first // stride
    column = first - row * stride
    scale = window[2]
    x = window[0] + scale * (left + column - MARGIN + 0.5 * (1 - below)) + 0.5 * (scale - 1)
    y = window[1] + scale * (top + row - MARGIN + 0.5 * below) + 0.5 * (scale - 1)
    return near, np.float32(x), np.float32(y), z[near]


@compiled(inlined=True, inner=True)
def is_silhouette(code, box, z):  # type: ignore[no-untyped-def]
    """Whether the farther pixel of a pair shows nothing of the object."""
    stride = box[2] - box[0] + 2 * MARGIN
    return z[(code >> 2) + (stride if code & 2 else 1) * (1 - (code & 1))] == 0


@compiled(inlined=True, inner=True)
def evidence(e, knots, widths, slopes):  # type: ignore[no-untyped-def]
    """What an energy says [nat / px] by one offset's ramps."""
    total = np.float32(0)
    for k in range(len(knots)):
        total += slopes[k] * min(max(e - knots[k], np.float32(0)), widths[k])
    return total


@compiled(inlined=True, inner=True)
def sums(box, z, volume, found):  # type: ignore[no-untyped-def]
    """Evidence and length [image px] of the contour in a z-buffer; found: memory for its pairs."""
    tensor, offsets, bias, keep = volume.tensor, volume.offsets, volume.bias, volume.keep
    knots, widths, slopes = volume.knots, volume.widths, volume.slopes
    window = (volume.left, volume.top, volume.scale)
    farthest, per_closeness = volume.farthest, volume.per_closeness
    count = find(box, keep, volume.merged, z, found)
    stride = box[2] - box[0] + 2 * MARGIN
    total, length = region_sum(box, z, volume), 0.0
    last, nx, ny = -1, np.float32(0), np.float32(0)
    for k in range(count):
        near, x, y, closeness = place(found[k], box, window, z)
        if near != last:
            last = near
            nx, ny = normal(near, stride, keep, z)
        if nx == 0 and ny == 0:
            continue
        label = np.float32((closeness - farthest) * per_closeness)
        value = bias
        for j in range(len(offsets)):
            off = offsets[j]
            e = sample(tensor, x + off * nx, y + off * ny, label, nx, ny)
            value += evidence(e, knots, widths, slopes[j])
        # A line is crossed by |nx| horizontal and |ny| vertical pairs for each pixel of it.
        pixels = window[2] / (abs(nx) + abs(ny))
        total += pixels * value
        length += pixels
    return total, length
