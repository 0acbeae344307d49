"""Fewer faces for the same outline: what a z-buffer cannot resolve need not be drawn."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import fast_simplification  # type: ignore[import-untyped]
import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.geometry.faces import Faces
from pmcl_ros.pmcl.object_model import ObjectModel

_FEWEST = 1000  # faces that are not worth simplifying, and the first try
_ROUNDS = 3  # of the library, which stops early on what is cut up and flat
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
    known = Faces.from_mesh(own)
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


@lru_cache(maxsize=16)  # a finer tolerance tries the same again
def _collapsed(model: ObjectModel, wanted: int) -> trimesh.Trimesh:
    """The model with about so many faces, or as few as the library dares."""
    vertices, faces = model.vertices, model.faces
    for _ in range(_ROUNDS):
        if len(faces) <= wanted:
            break
        vertices, faces = fast_simplification.simplify(
            np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int64),
            target_reduction=1 - wanted / len(faces), agg=1)
    return trimesh.Trimesh(vertices, faces, process=False)


def _within(own: trimesh.Trimesh, faces: Faces, mesh: trimesh.Trimesh, tolerance: float
            ) -> bool:
    """Whether vertices and centres of faces of both are within `tolerance` [m] of the other.

    faces: of `own`. What costs little is asked first.
    """
    few = max(1, (len(mesh.vertices) + len(mesh.faces)) // _FEW)
    there, here = _points(mesh), _points(own)
    if faces.farthest(there[::few]) > tolerance or faces.farthest(there) > tolerance:
        return False
    others = Faces.from_mesh(mesh)
    few = max(1, len(here) // _FEW)
    return others.farthest(here[::few]) <= tolerance and others.farthest(here) <= tolerance


def _points(mesh: trimesh.Trimesh) -> NDArray[np.float64]:
    return np.concatenate([mesh.vertices, mesh.triangles_center])
