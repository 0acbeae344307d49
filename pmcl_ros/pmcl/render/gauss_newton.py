"""Many poses uphill at once, each by Gauss-Newton steps of its own, on the processor.

The steps are those that `pmcl_ros.pmcl.local_model` takes from one pose, without what it knows of
how sure that is: a thread draws a pose, sums up the slopes along its contour, and moves it.
"""

import numba
import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.contour import (
    Edges,
    check_profile,
    energy,
    evidence,
    find,
    normal,
    place,
)
from pmcl_ros.pmcl.render.numba_renderer import thread_id
from pmcl_ros.pmcl.render.raster import MARGIN, Drawing, Room, draw
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.runtime.kernels import LOCK, compiled

_LEAST_CURVATURE = 0.02  # of the evidence [nat / px^3]: where there is no peak, little is known
_SHOWN = 1e-3  # nat / px: what a point counts at least
_WIDEST = np.array([0.05, 0.05, 0.05, 1, 1, 1])  # m, rad
_SHORTER, _LONGER = 0.25, 2.0  # the next step, after one that led down or up


class GaussNewton:
    """Moves poses to maxima of the contour's evidence in a scene.

    region: which their origins do not leave. step: how far aside slopes and curvature are taken
    [image px]. evaluations: poses drawn so far. Raises RenderError as scores do.
    """

    def __init__(self, scene: Scene, edges: EdgeVolume, profile: ContourProfile, region: Region,
                 step: float) -> None:
        check_profile(profile)
        self._drawing = Drawing.from_scene(scene)
        self._edges = Edges.from_volume(scene, edges, profile)
        threads: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
        self._room = Room.for_threads(self._drawing, threads)
        self._found = np.zeros((threads, 2 * self._room.z.shape[1]), np.int32)
        camera = edges.pinhole
        # Kernels are compiled for each combination of types that they are called with.
        self._camera = tuple(map(float, (camera.fx, camera.fy, camera.cx, camera.cy)))
        self._box = np.stack([region.low, region.high])
        self._step = float(step)
        self.evaluations = 0

    @classmethod
    def warm_up(cls) -> None:
        """Compile, or load from numba's cache, all that it needs."""
        camera = Pinhole(8, 8, 8.0, 8.0, 3.5, 3.5)
        corners = np.array([[0, 0, 1.0], [0, 0.4, 1], [0.4, 0, 1]])
        scene = Scene(ObjectModel('triangle', corners, np.array([[0, 1, 2]]), None, False), camera,
                      Window(0, 0, (8, 8)), 0.5, 2.0)
        edges = EdgeVolume(Header(), np.zeros((8, 8, 2, 3), np.float32), depth_labels(0.5, 2.0, 2),
                           camera)
        region = Region((0, 0, 1), (1, 1, 1))
        cls(scene, edges, ContourProfile.contrast(), region, 1.0)(np.eye(4)[None], 1, 1, 0.1)

    def __call__(self, poses: NDArray[np.float64], tries: int, farthest: float, converged: float
                 ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where poses (n, 4, 4) come to, and (n,) the evidence there [nat].

        tries: of steps, up or not, at most. farthest: that one goes; converged: shorter ones are
        none [image px, rms along the contour].
        """
        found = np.array(poses, np.float64, order='C')
        values, drawn = np.zeros(len(found)), np.zeros(len(found), np.int64)
        with LOCK:
            _climb(self._drawing, self._room, self._edges, self._found, self._camera, self._box,
                   self._step, int(tries), float(farthest), float(converged), found, values,
                   drawn)
        self.evaluations += int(drawn.sum())
        return found, values


@compiled(parallel=True)
def _climb(drawing, room, edges, found, camera, box, step, tries,  # type: ignore[no-untyped-def]
           farthest, converged, poses, values, drawn):
    for n in prange(len(poses)):
        k = thread_id()
        values[n], drawn[n] = _climbed(drawing, room.z[k], room.corners[k], room.exact[k], edges,
                                       found[k], camera, box, step, tries, farthest, converged,
                                       poses[n])


@compiled(inlined=True, inner=True)
def _climbed(drawing, z, corners, exact, edges, pairs, camera,  # type: ignore[no-untyped-def]
             box, step, tries, farthest, converged, best):
    """Move one pose; returns its evidence, and how often it was drawn."""
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
    """Of a positive definite matrix (6, 6), by Cholesky's method: the same digits everywhere."""
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
    """How far a tangent vector moves the contour, rms [px]; more than nothing."""
    square = 1e-18
    for i in range(6):
        for j in range(6):
            square += moments[i, j] * to[i] * to[j]
    return np.sqrt(square)


@compiled(inlined=True, inner=True)
def _move(pose, to, part, result):  # type: ignore[no-untyped-def]
    """A pose (4, 4) moved by a part of a tangent vector (6,), as `summary.moved` does."""
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
    """The evidence of the contour in a z-buffer; its expansion goes to the last three.

    Of a small motion of the object: as `local_model.LocalModel`.
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
    total, length, shown, bend = 0.0, 0.0, 0.0, 0.0
    last, nx, ny = -1, np.float32(0), np.float32(0)
    across = np.zeros(6)
    said = np.zeros(3)
    for k in range(count):
        near, x, y, closeness = place(found[k], box, window, z)
        if near != last:
            last = near
            nx, ny = normal(near, stride, keep, z)
        if nx == 0 and ny == 0:
            continue
        label = np.float32((closeness - edges.farthest) * edges.per_closeness)
        for i in range(3):
            said[i] = bias
            aside = np.float32((i - 1) * step)
            for j in range(len(offsets)):
                off = offsets[j] + aside
                e = energy(tensor, x + off * nx, y + off * ny, label, nx, ny)
                said[i] += evidence(e, knots, widths, slopes[j])
        weight = window[2] / (abs(nx) + abs(ny))
        total += weight * said[1]
        length += weight
        bend += weight * (2 * said[1] - said[0] - said[2])
        depth = 1.0 / closeness
        # Motion along the normal [px] per metre of shift and radian of turn about the origin.
        across[0], across[1] = fx * nx * closeness, fy * ny * closeness
        px, py = (x - cx) / fx * depth, (y - cy) / fy * depth
        across[2] = -(across[0] * px + across[1] * py) * closeness
        px, py, pz = px - origin[0], py - origin[1], depth - origin[2]
        across[3] = py * across[2] - pz * across[1]
        across[4] = pz * across[0] - px * across[2]
        across[5] = px * across[1] - py * across[0]
        slope = weight * (said[2] - said[0]) / (2 * step)
        peak = weight * (max(said[1], 0.0) + _SHOWN)
        shown += peak
        for a in range(6):
            gradient[a] += slope * across[a]
            for b in range(a + 1):
                product = across[a] * across[b]
                moments[a, b] += weight * product
                information[a, b] += peak * product
    # An edge's peak bends as it is high: where the contour shows none it tells nothing.
    curvature = max(bend / max(length, 1.0) / (step * step), _LEAST_CURVATURE)
    for a in range(6):
        for b in range(a + 1):
            information[a, b] *= curvature * length / max(shown, 1e-9)
            moments[a, b] /= max(length, 1.0)
            information[b, a], moments[b, a] = information[a, b], moments[a, b]
        information[a, a] += _LEAST_CURVATURE / (_WIDEST[a] * _WIDEST[a])
        moments[a, a] += 1e-12
    return total
