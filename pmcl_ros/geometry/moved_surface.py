"""How far motions take a surface off itself: what leaves it as it is, is a symmetry of it."""

import math
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.geometry.faces import Faces

_POINTS = 4000  # of the surface, and about as many vertices at most: they stick out
_STEPS = 200, 20, 1  # every so many-th is tried first: most motions are no symmetry


@dataclass(frozen=True)
class Surface:
    """Points (n, 3) of a surface [m], some vertices among them, and its faces."""

    points: NDArray[np.float64]
    faces: Faces

    @classmethod
    def from_mesh(cls, mesh: trimesh.Trimesh) -> 'Surface':
        """Of a mesh in metres."""
        vertices = np.asarray(mesh.vertices, np.float64)
        drawn = trimesh.sample.sample_surface(mesh, _POINTS, seed=0)[0]
        some = vertices[::math.ceil(len(vertices) / _POINTS)]
        return cls(np.concatenate([drawn, some]), Faces.from_mesh(mesh))

    def moved_by(self, motions: NDArray[np.float64], limit: float = math.inf) -> float:
        """How far motions (n, 4, 4) take points of the surface off it at most [m].

        limit: [m]; beyond it the result is infinite, and comes early.
        """
        farthest = 0.0
        for step in _STEPS:
            for each in motions:
                moved = self.points[::step] @ each[:3, :3].T + each[:3, 3]
                farthest = max(farthest, self.faces.farthest(moved))
                if farthest > limit:
                    return math.inf
        return farthest
