"""Gauss-Newton refinement of many poses at once, on the processor.

The steps are those of `pmcl_ros.pmcl.local_model`, without its covariances. Each thread draws a
pose, sums the slopes of the evidence along its contour, and moves it.
"""

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.contour import (
    Edges,
    check_profile,
    evidence,
    find,
    is_silhouette,
    normal,
    place,
    reading,
    region_at,
    region_sum,
)
from pmcl_ros.pmcl.render.numba_renderer import thread_id, tiny_scene
from pmcl_ros.pmcl.render.raster import MARGIN, Drawing, Room, draw
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime.kernels import LOCK, compiled

# Of a local model, here and in `LocalModel`:
LEAST_CURVATURE = 0.02  # nat / px^3: of the evidence, also where the contour shows no peak
LEAST_SHOWN = 1e-3  # nat / px: weight of a point without positive evidence
# m, rad: standard deviations of a weak prior, which keeps the information positive definite
WIDEST = np.array([0.05, 0.05, 0.05, 1, 1, 1])
_SHORTER, _LONGER = 0.25, 2.0  # factors of the next step, after a worse and a better pose


class GaussNewton:
    """Moves poses to maxima of the contour's evidence in a scene.

    region: bounds of the origins. step: of the finite differences along the normals [image px].
    evaluations: number of poses drawn so far. Raises RenderError as scores do.
    """

    def __init__(self, scene: Scene, edges: EvidenceVolume, profile: ContourProfile,
                 region: Region, step: float) -> None:
        check_profile(profile)
        self._drawing = Drawing.from_scene(scene)
        self._edges = Edges.from_volume(scene, edges, profile)
        self._room = Room.for_threads(self._drawing)
        threads, pixels = self._room.z.shape
        self._found = np.zeros((threads, 2 * pixels), np.int32)
        camera = edges.pinhole
        # Kernels are compiled for each combination of types that they are called with.
        self._camera = tuple(map(float, (camera.fx, camera.fy, camera.cx, camera.cy)))
        self._box = np.stack([region.low, region.high])
        self._step = float(step)
        self.evaluations = 0

    @classmethod
    def warm_up(cls) -> None:
        """Compile, or load from numba's cache, all that it needs."""
        region = Region((0, 0, 1), (1, 1, 1))
        cls(*tiny_scene(), ContourProfile.contrast(), region, 1.0)(np.eye(4)[None], 1, 1, 0.1)

    def __call__(self, poses: NDArray[np.float64], tries: int, farthest: float, converged: float
                 ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Refined poses (n, 4, 4) of `poses` (n, 4, 4), and their evidence (n,) [nat].

        tries: largest number of steps, also of rejected ones. farthest: largest step; converged:
        length of the step to stop at [image px, rms along the contour].
        """
        found = np.array(poses, np.float64, order='C')
        values, drawn = np.zeros(len(found)), np.zeros(len(found), np.int64)
        with LOCK:
            _refine_all(self._drawing, self._room, self._edges, self._found, self._camera,
                        self._box, self._step, int(tries), float(farthest), float(converged),
                        found, values, drawn)
        self.evaluations += int(drawn.sum())
        return found, values


@compiled(parallel=True)
def _refine_all(drawing, room, edges, found, camera, box, step, tries,  # type: ignore[no-untyped-def]
                farthest, converged, poses, values, drawn):
    for n in prange(len(poses)):
        k = thread_id()
        values[n], drawn[n] = _refine(drawing, room.z[k], room.corners[k], room.exact[k], edges,
                                      found[k], camera, box, step, tries, farthest, converged,
                                      poses[n])


@compiled(inlined=True, inner=True)
def _refine(drawing, z, corners, exact, edges, pairs, camera,  # type: ignore[no-untyped-def]
            box, step, tries, farthest, converged, best):
    """Refine one pose in place; returns its evidence and the number of drawings."""
    gradient, information, moments = np.zeros(6), np.zeros((6, 6)), np.zeros((6, 6))
    there, around, between = np.zeros(6), np.zeros((6, 6)), np.zeros((6, 6))
    tried, to = best.copy(), np.zeros(6)
    value, length, reach, drawn = -np.inf, farthest, farthest, 0
    for _ in range(tries + 1):
        window = draw(drawing, tried.astype(np.float32), corners, exact, z)
        reached = _slopes(window, z, edges, pairs, camera, tried[:3, 3], step, there, around,
                          between)
        drawn += 1
        if reached > value:
            value = reached
            for i in range(4):
                for j in range(4):
                    best[i, j] = tried[i, j]
            gradient, there = there, gradient
            information, around = around, information
            moments, between = between, moments
            reach = min(_LONGER * length, farthest)
        else:
            reach = _SHORTER * length
        _solve(information, gradient, to)
        motion = _length(moments, to)
        length = min(motion, reach)
        while length > converged:
            _move(best, to, length / motion, tried)
            inside = True
            for i in range(3):
                inside &= box[0, i] <= tried[i, 3] <= box[1, i]
            if inside:
                break
            length *= _SHORTER
        if length <= converged:
            break
    return value, drawn


@compiled(inlined=True, inner=True)
def _solve(matrix, given, result):  # type: ignore[no-untyped-def]
    """Solve with a positive definite matrix (6, 6), by Cholesky: the same digits everywhere."""
    lower = np.zeros((6, 6))
    for i in range(6):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            lower[i, j] = np.sqrt(max(rest, 1e-12)) if i == j else rest / lower[j, j]
    for i in range(6):
        rest = given[i]
        for k in range(i):
            rest -= lower[i, k] * result[k]
        result[i] = rest / lower[i, i]
    for i in range(5, -1, -1):
        rest = result[i]
        for k in range(i + 1, 6):
            rest -= lower[k, i] * result[k]
        result[i] = rest / lower[i, i]


@compiled(inlined=True, inner=True)
def _length(moments, to):  # type: ignore[no-untyped-def]
    """Motion of the contour by a tangent vector, rms [px]; positive."""
    square = 1e-18
    for i in range(6):
        for j in range(6):
            square += moments[i, j] * to[i] * to[j]
    return np.sqrt(square)


@compiled(inlined=True, inner=True)
def _move(pose, to, part, result):  # type: ignore[no-untyped-def]
    """A pose (4, 4) moved by a part of a tangent vector (6,), as by `se3.retract`."""
    x, y, z = part * to[3], part * to[4], part * to[5]
    angle = np.sqrt(x * x + y * y + z * z)
    a = np.sin(angle) / angle if angle > 1e-9 else 1.0
    b = (1 - np.cos(angle)) / (angle * angle) if angle > 1e-6 else 0.5
    for k in range(3):  # Rodrigues: v + a w x v + b w x (w x v)
        u, v, w = pose[0, k], pose[1, k], pose[2, k]
        cu, cv, cw = y * w - z * v, z * u - x * w, x * v - y * u
        result[0, k] = u + a * cu + b * (y * cw - z * cv)
        result[1, k] = v + a * cv + b * (z * cu - x * cw)
        result[2, k] = w + a * cw + b * (x * cv - y * cu)
        result[k, 3] = pose[k, 3] + part * to[k]


@compiled(inlined=True, inner=True)
def _slopes(box, z, edges, found, camera, origin, step,  # type: ignore[no-untyped-def]
            gradient, information, moments):
    """The evidence of the contour in a z-buffer [nat]; its expansion goes to the last three.

    The expansion is that of `local_model.LocalModel`.
    """
    tensor, offsets, bias, keep = edges.tensor, edges.offsets, edges.bias, edges.keep
    knots, widths, slopes = edges.knots, edges.widths, edges.slopes
    window = (edges.left, edges.top, edges.scale)
    fx, fy, cx, cy = camera
    count = find(box, keep, z, found)
    stride = box[2] - box[0] + 2 * MARGIN
    for a in range(6):
        gradient[a] = 0.0
        for b in range(6):
            information[a, b], moments[a, b] = 0.0, 0.0
    total, length, shown, bend = region_sum(box, z, edges), 0.0, 0.0, 0.0
    inside = edges.region.shape[0] > 0
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
        label = np.float32((closeness - edges.farthest) * edges.per_closeness)
        for i in range(3):
            values[i] = bias
            aside = np.float32((i - 1) * step)
            for j in range(len(offsets)):
                off = offsets[j] + aside
                e = reading(tensor, x + off * nx, y + off * ny, label, nx, ny)
                values[i] += evidence(e, knots, widths, slopes[j])
        weight = window[2] / (abs(nx) + abs(ny))
        total += weight * values[1]
        length += weight
        bend += weight * (2 * values[1] - values[0] - values[2])
        depth = 1.0 / closeness
        # Motion along the normal [px] per metre of shift and radian of turn about the origin.
        across[0], across[1] = fx * nx * closeness, fy * ny * closeness
        px, py = (x - cx) / fx * depth, (y - cy) / fy * depth
        across[2] = -(across[0] * px + across[1] * py) * closeness
        px, py, pz = px - origin[0], py - origin[1], depth - origin[2]
        across[3] = py * across[2] - pz * across[1]
        across[4] = pz * across[0] - px * across[2]
        across[5] = px * across[1] - py * across[0]
        slope = weight * (values[2] - values[0]) / (2 * step)
        if inside and is_silhouette(found[k], box, z):
            # A silhouette that moves outwards covers more.
            slope += weight * region_at(edges.region, x, y, label)
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
            moments[a, b] /= max(length, 1.0)
            information[b, a], moments[b, a] = information[a, b], moments[a, b]
        information[a, a] += LEAST_CURVATURE / (WIDEST[a] * WIDEST[a])
        moments[a, a] += 1e-12
    return total
