"""Fewer faces for the same outline: what a z-buffer cannot resolve need not be drawn."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import fast_simplification  # type: ignore[import-untyped]
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.kernels import compiled

_FEWEST = 1000  # faces that are not worth simplifying, and the first try
_PIECES = 64  # of the model's diameter: faces are cut to such pieces, to be found by their centres
_NEAR = 16  # pieces whose faces are tried for the nearest
_ROUNDS = 3
_FINER = 16  # a model of so many to its radius shows what refraction bends
_FEW = 4000  # points that a try must pass first


@lru_cache(maxsize=8)
def simplified(model: ObjectModel, tolerance: float) -> ObjectModel:
    """The model with as few faces as keep both surfaces within `tolerance` [m] of each other.

    A silhouette then moves by tolerance * focal length / depth pixels at most. Edges collapse in
    the order of their quadric error (Garland and Heckbert 1997): flat parts keep few faces, rims
    and thin stems many. The distance is an upper bound at all vertices and centres of faces of
    both; the model itself where that takes about as many faces as it has.
    """
    wanted = _FEWEST
    if wanted >= 0.7 * len(model.faces):
        return model
    own = trimesh.Trimesh(model.vertices, model.faces, process=False)
    known = Faces.from_mesh(own, model.diameter)
    while wanted < 0.7 * len(model.faces):
        mesh = _collapsed(model, wanted)
        if len(mesh.faces) < 0.7 * len(model.faces) and _within(own, known, mesh, tolerance):
            return replace(model, vertices=np.asarray(mesh.vertices, np.float64),
                           faces=np.asarray(mesh.faces, np.int64),
                           closed=model.closed and bool(mesh.is_volume))
        wanted = wanted * 3 // 2
    return model


@lru_cache(maxsize=8)
def longest_edge(model: ObjectModel) -> float:
    """Of a subdivided model [m]."""
    return model.radius / _FINER


def subdivided(model: ObjectModel) -> ObjectModel:
    """The model with edges of at most `longest_edge`: straight edges can then bend."""
    subdivide: Any = trimesh.remesh.subdivide_to_size
    vertices, faces = subdivide(model.vertices, model.faces, longest_edge(model))
    merged = trimesh.Trimesh(vertices, faces, process=False)
    merged.merge_vertices()
    return replace(model, vertices=np.asarray(merged.vertices, np.float64),
                   faces=np.asarray(merged.faces, np.int64))


def _collapsed(model: ObjectModel, wanted: int) -> trimesh.Trimesh:
    """The model with about so many faces, or as few as the library dares."""
    vertices, faces = model.vertices, model.faces
    for _ in range(_ROUNDS):  # it stops early on what is cut up and flat
        if len(faces) <= wanted:
            break
        vertices, faces = fast_simplification.simplify(
            np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int64),
            target_reduction=1 - wanted / len(faces), agg=1)
    return trimesh.Trimesh(vertices, faces, process=False)


def _within(own: trimesh.Trimesh, faces: 'Faces', mesh: trimesh.Trimesh, tolerance: float
            ) -> bool:
    """Whether vertices and centres of faces of both are within `tolerance` [m] of the other.

    faces: of `own`. What costs little is asked first.
    """
    few = max(1, (len(mesh.vertices) + len(mesh.faces)) // _FEW)
    there, here = _points(mesh), _points(own)
    if faces.distances(there[::few]).max() > tolerance or faces.distances(there).max() > tolerance:
        return False
    others = Faces.from_mesh(mesh, faces.diameter)
    few = max(1, len(here) // _FEW)
    return (others.distances(here[::few]).max() <= tolerance
            and others.distances(here).max() <= tolerance)


def _points(mesh: trimesh.Trimesh) -> NDArray[np.float64]:
    return np.concatenate([mesh.vertices, mesh.triangles_center])


@dataclass(frozen=True)
class Faces:
    """Triangles (m, 3, 3) and a tree of their pieces' centres, `owner` (k,) their faces.

    diameter: of the model [m].
    """

    triangles: NDArray[np.float64]
    tree: cKDTree
    owner: NDArray[np.int64]
    diameter: float

    @classmethod
    def from_mesh(cls, mesh: trimesh.Trimesh, diameter: float) -> 'Faces':
        """Of a mesh."""
        subdivide: Any = trimesh.remesh.subdivide_to_size
        vertices, faces, owner = subdivide(
            mesh.vertices, mesh.faces, diameter / _PIECES, max_iter=20, return_index=True)
        return cls(np.ascontiguousarray(mesh.triangles, np.float64),
                   cKDTree(vertices[faces].mean(axis=1)), np.asarray(owner, np.int64),
                   diameter)

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) upper bounds of the distance of points (n, 3), exact but for strange meshes [m]."""
        points = np.ascontiguousarray(points)  # as most are: one kernel serves all
        near = self.owner[self.tree.query(points, k=min(_NEAR, len(self.owner)))[1]]
        return np.asarray(_to_faces(points, self.triangles, near))


@compiled()
def _to_faces(points, triangles, near):  # type: ignore[no-untyped-def]
    """(n,) distance of points (n, 3) to the nearest of the triangles `near` (n, k)."""
    result = np.zeros(len(points))
    for n in range(len(points)):
        least = np.inf
        for k in range(near.shape[1]):
            least = min(least, _to_face(points[n], triangles[near[n, k]]))
        result[n] = np.sqrt(least)
    return result


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
