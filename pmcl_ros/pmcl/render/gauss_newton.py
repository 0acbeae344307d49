"""Gauss-Newton refinement of many poses at once, by one view or several.

The steps are those of `pmcl_ros.pmcl.local_model`, without its covariances. The processor draws
each pose in each view, and sums the slopes of the evidence along its contour.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.contour import (
    KernelVolume,
    check_profile,
    evidence,
    find,
    is_silhouette,
    normal,
    place,
    region_at,
    region_sum,
    sample,
)
from pmcl_ros.pmcl.render.numba_renderer import tiny_scene
from pmcl_ros.pmcl.render.raster import MARGIN, Buffers, Drawing, draw, own_buffers
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.kernels import borrowed, compiled, rounds

# Of a local model, here and in `LocalModel`:
LEAST_CURVATURE = 0.02  # nat / px^3: of the evidence, also where the contour shows no peak
LEAST_SHOWN = 1e-3  # nat / px: weight of a point without positive evidence
# m, rad: standard deviations of a weak prior, which keeps the information positive definite
WIDEST = np.array([0.05, 0.05, 0.05, 1, 1, 1])
_SHORTER, _LONGER = 0.25, 2.0  # factors of the next step, after a worse and a better pose
_STILL = 1e-18  # px^2: keeps the motion of no contour positive


@dataclass(frozen=True)
class Expansion:
    """The contour's evidence at poses, to second order: sums over the contour.

    values: (n,) evidence [nat]. lengths: (n,) of the contour [px]. gradient: (n, 6) and
    information: (n, 6, 6), minus the second derivative, of the evidence in the tangent space
    [m, rad]. moments: (n, 6, 6) of the motions along the normals [px^2 px].
    """

    values: NDArray[np.float64]
    lengths: NDArray[np.float64]
    gradient: NDArray[np.float64]
    information: NDArray[np.float64]
    moments: NDArray[np.float64]

    @classmethod
    def blank(cls, count: int) -> 'Expansion':
        """Zeros, of `count` poses."""
        return cls(np.zeros(count), np.zeros(count), np.zeros((count, 6)),
                   np.zeros((count, 6, 6)), np.zeros((count, 6, 6)))

    def __add__(self, other: 'Expansion') -> 'Expansion':
        return Expansion(*(getattr(self, each) + getattr(other, each)
                           for each in self.__dataclass_fields__))

    def rotated(self, rotation: NDArray[np.float64]) -> 'Expansion':
        """In a frame into which `rotation` (3, 3) turns directions."""
        both = np.kron(np.eye(2), rotation)
        return Expansion(self.values, self.lengths, self.gradient @ both.T,
                         both @ self.information @ both.T, both @ self.moments @ both.T)

    def put(self, where: NDArray[np.integer], other: 'Expansion', chosen: NDArray[np.bool_]
            ) -> None:
        """Take over the chosen poses of another, in place."""
        for each in self.__dataclass_fields__:
            getattr(self, each)[where[chosen]] = getattr(other, each)[chosen]


class ContourExpansion:
    """Expands the evidence of poses in one view, or with others (`of_all`): `Expansion`.

    step: of the finite differences along the normals [image px]. camera: (4, 4) of the view, in
    the frame of the poses; default: that frame.
    evaluations: number of poses drawn so far. Raises RenderError as scores do.
    """

    def __init__(self, scene: Scene, volume: EvidenceVolume, profile: ContourProfile, step: float,
                 camera: NDArray[np.float64] | None = None) -> None:
        check_profile(profile)
        self._drawing = Drawing.from_scene(scene)
        self._volume = KernelVolume.from_volume(scene, volume, profile)
        self._buffers = Buffers.for_threads(self._drawing)
        threads, pixels = self._buffers.z.shape
        self._found = np.zeros((threads, 2 * pixels), np.int32)
        pinhole = volume.pinhole
        # Kernels are compiled for each combination of types that they are called with.
        self._pinhole = tuple(map(float, (pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy)))
        self._camera = camera
        self._step = float(step)
        self.evaluations = 0

    @classmethod
    def of_all(cls, views: Sequence['ContourExpansion'], poses: NDArray[np.float64]) -> Expansion:
        """At poses (n, 4, 4), summed over views (one at least), which the threads share."""
        made = [Expansion.blank(len(poses)) for _ in views]
        _expand.together([each._arguments(poses, found)
                          for each, found in zip(views, made, strict=True)])
        for each in views:
            each.evaluations += len(poses)
        first, *others = (each._in_frame(found) for each, found in zip(views, made, strict=True))
        return sum(others, first)

    def _arguments(self, poses: NDArray[np.float64], made: Expansion) -> tuple[Any, ...]:
        """What `_expand` is called with."""
        if self._camera is not None:
            poses = np.linalg.inv(self._camera) @ poses
        return (self._drawing, self._buffers, self._volume, self._found, self._pinhole, self._step,
                np.array(poses, np.float64, order='C'), made.values, made.lengths, made.gradient,
                made.information, made.moments)

    def _in_frame(self, made: Expansion) -> Expansion:
        return made if self._camera is None else made.rotated(self._camera[:3, :3])


class GaussNewton:
    """Moves poses to maxima of the contour's evidence, summed over views.

    views: one at least. region: bounds of the origins, in the frame of the poses.
    """

    def __init__(self, views: Sequence[ContourExpansion], region: Region) -> None:
        self._views = views
        self._low, self._high = region.low, region.high

    @classmethod
    def warm_up(cls) -> None:
        """Compile, or load from numba's cache, all that it needs."""
        view = ContourExpansion(*tiny_scene(), ContourProfile.contrast(), 1.0)
        cls([view], Region((0, 0, 1), (1, 1, 1)))(np.eye(4)[None], 1, 1, 0.1)

    @property
    def evaluations(self) -> int:
        """Number of poses drawn so far, in each view."""
        return sum(each.evaluations for each in self._views)

    def __call__(self, poses: NDArray[np.float64], tries: int, farthest: float, converged: float
                 ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Refined poses (n, 4, 4) of `poses` (n, 4, 4), and their evidence (n,) [nat].

        tries: largest number of steps, also of rejected ones. farthest: largest step; converged:
        length of the step to stop at [image px, rms along the contour].
        """
        best = np.array(poses, np.float64, order='C')
        at = self._expanded(best)
        reach = np.full(len(best), float(farthest))
        going = np.arange(len(best))
        for _ in range(tries):
            tried, length, inside = self._step_from(
                best[going], at.gradient[going], at.information[going], at.moments[going],
                at.lengths[going], reach[going], converged)
            going, tried, length = going[inside], tried[inside], length[inside]
            if not len(going):
                break
            there = self._expanded(tried)
            better = there.values > at.values[going]
            best[going[better]] = tried[better]
            at.put(going, there, better)
            reach[going] = np.where(better, np.minimum(_LONGER * length, farthest),
                                    _SHORTER * length)
        return best, at.values

    def _expanded(self, poses: NDArray[np.float64]) -> Expansion:
        return ContourExpansion.of_all(self._views, poses)

    def _step_from(self, poses: NDArray[np.float64], gradient: NDArray[np.float64],
                   information: NDArray[np.float64], moments: NDArray[np.float64],
                   lengths: NDArray[np.float64], reach: NDArray[np.float64], converged: float
                   ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Poses a step on (n, 4, 4), its length (n,) [px], and whether there is one (n,).

        A step that leaves the region is shortened.
        """
        weak = information + np.diag(LEAST_CURVATURE / WIDEST ** 2)
        step = np.linalg.solve(weak, gradient[..., None])
        square = step.transpose(0, 2, 1) @ moments @ step
        motion = np.sqrt(square[:, 0, 0] / np.maximum(lengths, 1) + _STILL)
        step = step[..., 0] / motion[:, None]
        length = np.minimum(motion, reach)
        while True:
            there = poses[:, :3, 3] + length[:, None] * step[:, :3]
            outside = ((there < self._low) | (there > self._high)).any(axis=1)
            outside &= length > converged
            if not outside.any():
                break
            length[outside] *= _SHORTER
        return retract(poses, length[:, None] * step), length, length > converged


@compiled(parallel=True)
def _expand(drawing, buffers, volume, found, camera, step, poses,  # type: ignore[no-untyped-def]
            values, lengths, gradient, information, moments, portion):
    corners, exact, z = own_buffers(buffers, portion[0])
    pairs = borrowed(found[portion[0]])
    for n in rounds(len(poses), portion):
        window = draw(drawing, poses[n].astype(np.float32), corners, exact, z)
        values[n], lengths[n] = _slopes(window, z, volume, pairs, camera, poses[n, :3, 3], step,
                                        gradient[n], information[n], moments[n])


@compiled(inlined=True, inner=True)
def _slopes(box, z, volume, found, camera, origin, step,  # type: ignore[no-untyped-def]
            gradient, information, moments):
    """The contour's evidence in a z-buffer [nat], its length [px]; more goes to the last three.

    The expansion is that of `local_model.LocalModel`.
    """
    tensor, offsets, bias, keep = volume.tensor, volume.offsets, volume.bias, volume.keep
    knots, widths, slopes = volume.knots, volume.widths, volume.slopes
    window = (volume.left, volume.top, volume.scale)
    count = find(box, keep, volume.merged, z, found)
    stride = box[2] - box[0] + 2 * MARGIN
    total, length, shown, bend = region_sum(box, z, volume), 0.0, 0.0, 0.0
    inside = volume.region.shape[0] > 0
    last, nx, ny = -1, np.float32(0), np.float32(0)
    across = np.zeros(6)
    values = np.zeros(3)
    for k in range(count):
        near, x, y, closeness = place(found[k], box, window, z)
        if near != last:
            last = near
            nx, ny = normal(near, stride, keep, z)
        if nx == 0 and ny == 0:
            continue
        label = np.float32((closeness - volume.farthest) * volume.per_closeness)
        for i in range(3):
            values[i] = bias
            aside = np.float32((i - 1) * step)
            for j in range(len(offsets)):
                off = offsets[j] + aside
                e = sample(tensor, x + off * nx, y + off * ny, label, nx, ny)
                values[i] += evidence(e, knots, widths, slopes[j])
        weight = window[2] / (abs(nx) + abs(ny))
        total += weight * values[1]
        length += weight
        bend += weight * (2 * values[1] - values[0] - values[2])
        _motion(x, y, closeness, nx, ny, camera, origin, across)
        slope = weight * (values[2] - values[0]) / (2 * step)
        if inside and is_silhouette(found[k], box, z):
            # A silhouette that moves outwards covers more.
            slope += weight * region_at(volume.region, x, y, label)
        peak = weight * (max(values[1], 0.0) + LEAST_SHOWN)
        shown += peak
        for a in range(6):
            gradient[a] += slope * across[a]
            for b in range(a + 1):
                product = across[a] * across[b]
                moments[a, b] += weight * product
                information[a, b] += peak * product
    # The curvature at an edge grows with its height: no edge, no information.
    curvature = max(bend / max(length, 1.0) / (step * step), LEAST_CURVATURE)
    for a in range(6):
        for b in range(a + 1):
            information[a, b] *= curvature * length / max(shown, 1e-9)
            information[b, a], moments[b, a] = information[a, b], moments[a, b]
    return total, length


@compiled(inlined=True, inner=True)
def _motion(x, y, closeness, nx, ny, camera, origin, across):  # type: ignore[no-untyped-def]
    """Write what `view_terms.normal_motion` gives of one point into across (6,)."""
    fx, fy, cx, cy = camera
    depth = 1.0 / closeness
    across[0], across[1] = fx * nx * closeness, fy * ny * closeness
    px, py = (x - cx) / fx * depth, (y - cy) / fy * depth
    across[2] = -(across[0] * px + across[1] * py) * closeness
    px, py, pz = px - origin[0], py - origin[1], depth - origin[2]
    across[3] = py * across[2] - pz * across[1]
    across[4] = pz * across[0] - px * across[2]
    across[5] = px * across[1] - py * across[0]
