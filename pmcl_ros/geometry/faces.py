"""The distance of points to the faces of a mesh."""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pmcl_ros.runtime.kernels import compiled

_FEW = 8  # faces in a box, boxes in a larger one
_DEPTH = 256  # more boxes than wait to be opened: 7 at each of 32 levels


@dataclass(frozen=True)
class Faces:
    """Faces of a mesh in a hierarchy of boxes: most are farther than their box, and left out.

    triangles: (m, 3, 3) [m], neighbours in a row. boxes: (k, 2, 3) lowest and highest corner [m]
    of each eight triangles, then of each eight boxes, and so on up to one. starts: (levels + 1,)
    where the boxes of each level begin.
    """

    triangles: NDArray[np.float64]
    boxes: NDArray[np.float64]
    starts: NDArray[np.int64]

    @classmethod
    def from_mesh(cls, mesh: trimesh.Trimesh) -> 'Faces':
        """Of a mesh with one face at least."""
        corners = np.asarray(mesh.triangles, np.float64)
        corners = np.ascontiguousarray(corners[cKDTree(corners.mean(axis=1), _FEW).indices])
        low, high = corners.min(axis=1), corners.max(axis=1)
        levels: list[NDArray[np.float64]] = []
        while not levels or len(low) > 1:
            first = np.arange(0, len(low), _FEW)
            low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
            levels.append(np.stack([low, high], axis=1))
        starts = np.cumsum([0, *map(len, levels)])
        return cls(corners, np.concatenate(levels), np.asarray(starts, np.int64))

    def farthest(self, points: NDArray[np.float64]) -> float:
        """The largest distance of points (n, 3) to their nearest face [m], 0 without a point.

        It is found sooner than all distances: of most points a near face is enough.
        """
        points = np.ascontiguousarray(points, np.float64)  # as most are: one kernel serves all
        return float(_farthest(points, self.triangles, self.boxes, self.starts))


@compiled()
def _farthest(points, triangles, boxes, starts):  # type: ignore[no-untyped-def]
    """The largest distance of points (n, 3) to their nearest triangle."""
    result = 0.0
    levels, places = np.zeros(_DEPTH, np.int64), np.zeros(_DEPTH, np.int64)
    bounds = np.zeros(_DEPTH)
    for n in range(len(points)):
        result = max(result, _to_nearest(points[n], triangles, boxes, starts, result, levels,
                                         places, bounds))
    return np.sqrt(result)


@compiled(inlined=True, inner=True)
def _to_nearest(  # type: ignore[no-untyped-def]
        point, triangles, boxes, starts, enough, levels, places, bounds):
    """Square of the distance to the nearest triangle, or of one that is at most `enough`.

    levels, places, bounds: (_DEPTH,) of boxes that wait to be opened, the nearest ones first.
    """
    least, waiting = np.inf, 1
    levels[0], places[0], bounds[0] = len(starts) - 2, 0, 0.0
    while waiting > 0 and least > enough:
        waiting -= 1
        level, first = levels[waiting], _FEW * places[waiting]
        if bounds[waiting] >= least:
            continue
        if level == 0:
            for k in range(first, min(first + _FEW, len(triangles))):
                least = min(least, _to_face(point, triangles[k]))
            continue
        bottom = waiting
        for k in range(first, min(first + _FEW, starts[level] - starts[level - 1])):
            bound = _to_box(point, boxes[starts[level - 1] + k])
            if bound >= least:
                continue
            levels[waiting], places[waiting], bounds[waiting] = level - 1, k, bound
            if waiting > bottom and bound > bounds[waiting - 1]:  # the nearest stays on top
                places[waiting], places[waiting - 1] = places[waiting - 1], k
                bounds[waiting], bounds[waiting - 1] = bounds[waiting - 1], bound
            waiting += 1
    return least


@compiled(inlined=True, inner=True)
def _to_box(point, box):  # type: ignore[no-untyped-def]
    """Square of the distance from a point to a box (2, 3), 0 in it."""
    square = 0.0
    for k in range(3):
        square += max(box[0, k] - point[k], point[k] - box[1, k], 0.0) ** 2
    return square


@compiled(inlined=True, inner=True)
def _to_face(point, triangle):  # type: ignore[no-untyped-def]
    """Square of the distance from a point to a triangle (3, 3)."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    uu, uv, vv, pu, pv = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        ab, ac, ap = b[k] - a[k], c[k] - a[k], point[k] - a[k]
        uu, uv, vv = uu + ab * ab, uv + ab * ac, vv + ac * ac
        pu, pv = pu + ap * ab, pv + ap * ac
    area = uu * vv - uv * uv
    if area > 0:
        u, v = (vv * pu - uv * pv) / area, (uu * pv - uv * pu) / area
        if u >= 0 and v >= 0 and u + v <= 1:  # straight above the face
            square = 0.0
            for k in range(3):
                square += (point[k] - a[k] - u * (b[k] - a[k]) - v * (c[k] - a[k])) ** 2
            return square
    return min(_to_edge(point, a, b), _to_edge(point, b, c), _to_edge(point, c, a))


@compiled(inlined=True, inner=True)
def _to_edge(point, a, b):  # type: ignore[no-untyped-def]
    """Square of the distance from a point to a straight edge."""
    along, square, off = 0.0, 0.0, 0.0
    for k in range(3):
        along += (point[k] - a[k]) * (b[k] - a[k])
        square += (b[k] - a[k]) ** 2
    part = min(max(along / square, 0.0), 1.0) if square > 0 else 0.0
    for k in range(3):
        off += (point[k] - a[k] - part * (b[k] - a[k])) ** 2
    return off
