"""The inside of an object: how deep a point is in it, and how deep two objects are in each other.

Distances are to points on the surface, about a millimetre apart for what stands on a table, and
inside across the face that the nearest is on.
"""

import logging
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from pmcl_ros.pmcl.object_model import ObjectModel

_LOG = logging.getLogger(__name__)
_SURFACE, _TRIED = 60_000, 3000  # points of the surface: to be near to; to be inside others
_GRID = 21  # points along each side of it that are tried for its deepest
_NEAREST = 6  # of them, that tell whether a point is inside


@dataclass(frozen=True)
class Contact:
    """Where one of two objects is deepest in the other.

    depth: [m]; negative or 0: they do not interpenetrate. place: (3,) there, camera's frame [m].
    normal: (3,) unit, the way that the first has to go.
    """

    depth: float
    place: NDArray[np.float64]
    normal: NDArray[np.float64]


_APART = Contact(-np.inf, np.zeros(3), np.zeros(3))


@dataclass(frozen=True, eq=False)
class Solid:
    """What an object's mesh encloses, in its own frame.

    A vessel's mesh with its cavity is a shell: what is in the cavity is outside. Modelled by its
    outer surface alone, closed by a lid, it is massive. A mesh that is not closed encloses
    nothing.

    tree: of points on the surface; normals: (n, 3) unit, outwards, of their faces.
    tried: (m, 3) points that must not be inside others; facing: (m, 3) unit, outwards.
    radius: of the mesh about its origin [m]. core, core_radius: the largest ball inside [m].
    """

    tree: cKDTree
    normals: NDArray[np.float64]
    tried: NDArray[np.float64]
    facing: NDArray[np.float64]
    radius: float
    closed: bool
    core: NDArray[np.float64]
    core_radius: float

    @classmethod
    def of(cls, model: ObjectModel) -> 'Solid':
        """Of an object; the same for the same mesh."""
        mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
        if not model.closed:
            _LOG.warning('the mesh of %s is not closed: nothing can be told to be inside it',
                         model.name)
        points, faces = trimesh.sample.sample_surface(mesh, _SURFACE, seed=0)[:2]
        tried = trimesh.sample.sample_surface(mesh, _TRIED, seed=1)[0]
        corners = model.vertices[ConvexHull(model.vertices, qhull_options='QJ').vertices]
        tree, normals = cKDTree(points), np.asarray(mesh.face_normals, float)[faces]
        tried = np.concatenate([tried, corners])
        facing = normals[tree.query(tried, k=_NEAREST)[1]].mean(axis=1)
        facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-9)
        made = cls(tree, normals, tried, facing, model.radius, model.closed, np.zeros(3), 0.0)
        low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
        grid = np.stack(np.meshgrid(*np.linspace(low, high, _GRID).T), axis=-1).reshape(-1, 3)
        depths = made.depths(grid)[0]
        deepest = int(depths.argmax())
        return replace(made, core=grid[deepest], core_radius=max(float(depths[deepest]), 0.0))

    def depths(self, points: NDArray[np.float64]
               ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n,) how deep points (n, 3) are inside [m], negative outside; (n, 3) the way out."""
        if not self.closed:
            return np.full(len(points), -np.inf), np.zeros((len(points), 3))
        away, nearest = self.tree.query(points, k=_NEAREST)
        apart = self.tree.data[nearest[:, 0]] - points
        # At an edge the nearest faces decide together, in front of which of them a point is.
        together = self.normals[nearest].mean(axis=1)
        inside = (apart * together).sum(axis=1) > 0
        normals = self.normals[nearest[:, 0]]
        across = (apart * normals).sum(axis=1)
        # Across a face it is the distance from the face; about an edge, from the point on it.
        near = inside & (across > 0.5 * away[:, 0])
        return np.where(near, across, np.where(inside, away[:, 0], -away[:, 0])), normals

    def into(self, pose: NDArray[np.float64], other: 'Solid', place: NDArray[np.float64]
             ) -> Contact:
        """Where this at a pose (4, 4) is deepest in the other at `place` (4, 4)."""
        to_other = np.linalg.inv(place) @ pose
        points = self.tried @ to_other[:3, :3].T + to_other[:3, 3]
        near = (points ** 2).sum(axis=1) < other.radius ** 2
        if not near.any():
            return _APART
        depths, normals = other.depths(points[near])
        deepest = int(depths.argmax())
        way = place[:3, :3] @ normals[deepest]
        back = -(pose[:3, :3] @ self.facing[near][deepest])
        # A point that is deeper than the middle comes out soonest on the other side.
        return Contact(float(depths[deepest]),
                       place[:3, :3] @ points[near][deepest] + place[:3, 3],
                       way if way @ back > 0 else back)


def contact(first: Solid, pose: NDArray[np.float64], second: Solid, place: NDArray[np.float64]
            ) -> Contact:
    """Where two solids at poses (4, 4) are deepest in each other."""
    if np.linalg.norm(pose[:3, 3] - place[:3, 3]) >= first.radius + second.radius:
        return _APART
    one, two = first.into(pose, second, place), second.into(place, first, pose)
    return one if one.depth >= two.depth else Contact(two.depth, two.place, -two.normal)
