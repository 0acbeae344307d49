"""Penetration of objects: its depth, and the smallest change of the poses that resolves it.

Distances are measured to points of the surface, about 1 mm apart on objects of table size; inside
of the object across the face of the nearest point.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.object_model import ObjectModel

_LOG = logging.getLogger(__name__)
MAX_PENETRATION = 0.002  # m: of two objects in an estimate
_RESIDUAL = 0.001  # m: residual penetration; surfaces are sampled at about 1 mm
_ITERATIONS = 40  # moves of a pair; two objects need two, a crowd pushes on
_SURFACE, _SAMPLES = 60_000, 3000  # points of the surface: for distances, for contacts
_GRID = 21  # points along each side of the bounding box, for the inscribed ball
_BALLS = 0.8  # of the sum of their radii: by which inscribed balls must be apart
_NEAREST = 6  # surface points that decide whether a point is inside


@dataclass(frozen=True)
class Contact:
    """The deepest point of one object in another.

    depth: [m]; 0 or less without penetration. place: (3,) in the camera's frame [m]. normal: (3,)
    unit vector along which the first object leaves the second.
    """

    depth: float
    place: NDArray[np.float64]
    normal: NDArray[np.float64]


_APART = Contact(-np.inf, np.zeros(3), np.zeros(3))


@dataclass(frozen=True, eq=False)
class Interior:
    """The interior of a mesh, in the object's frame.

    The cavity of a vessel is outside where the mesh has an inner wall, and inside where it is
    closed by a lid. A mesh that is not closed has no interior.

    tree: points of the surface; normals: (n, 3) unit, outward, of their faces.
    samples: (m, 3) points for contacts [m], of the surface and the core; sample_normals: (m, 3)
        unit, outward; 0 of the core.
    radius: of the mesh about its origin [m]. core, core_radius: the largest inscribed ball [m].
    """

    tree: cKDTree
    normals: NDArray[np.float64]
    samples: NDArray[np.float64]
    sample_normals: NDArray[np.float64]
    radius: float
    closed: bool
    core: NDArray[np.float64]
    core_radius: float

    @classmethod
    def from_model(cls, model: ObjectModel) -> 'Interior':
        """The interior of an object; the surface is sampled with a fixed seed."""
        mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
        if not model.closed:
            _LOG.warning('the mesh of %s is not closed: penetration into it cannot be detected',
                         model.name)
        points, faces = trimesh.sample.sample_surface(mesh, _SURFACE, seed=0)[:2]
        samples = trimesh.sample.sample_surface(mesh, _SAMPLES, seed=1)[0]
        corners = model.vertices[ConvexHull(model.vertices, qhull_options='QJ').vertices]
        tree, normals = cKDTree(points), np.asarray(mesh.face_normals, float)[faces]
        samples = np.concatenate([samples, corners])
        sample_normals = normals[tree.query(samples, k=_NEAREST)[1]].mean(axis=1)
        sample_normals /= np.maximum(
            np.linalg.norm(sample_normals, axis=1, keepdims=True), 1e-9)
        made = cls(tree, normals, samples, sample_normals, model.radius, model.closed, np.zeros(3),
                   0.0)
        low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
        grid = np.stack(np.meshgrid(*np.linspace(low, high, _GRID).T), axis=-1).reshape(-1, 3)
        depths = made.depths(grid)[0]
        deepest = int(depths.argmax())
        made = replace(made, core=grid[deepest], core_radius=max(float(depths[deepest]), 0.0))
        if not made.core_radius:
            return made
        # Of two objects in one place no point of a surface is deep in the other.
        return replace(made, samples=np.concatenate([samples, made.core[None]]),
                       sample_normals=np.concatenate([sample_normals, np.zeros((1, 3))]))

    def depths(self, points: NDArray[np.float64]
               ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n,) depths of points (n, 3) inside [m], negative outside; (n, 3) normals, outward."""
        if not self.closed:
            return np.full(len(points), -np.inf), np.zeros((len(points), 3))
        away, nearest = self.tree.query(points, k=_NEAREST)
        apart = self.tree.data[nearest[:, 0]] - points
        # At an edge of the mesh the mean normal of the nearest faces decides.
        mean_normal = self.normals[nearest].mean(axis=1)
        inside = (apart * mean_normal).sum(axis=1) > 0
        normals = self.normals[nearest[:, 0]]
        across = (apart * normals).sum(axis=1)
        # Before a face: the distance to the face; about an edge: to the point on it.
        near = inside & (across > 0.5 * away[:, 0])
        return np.where(near, across, np.where(inside, away[:, 0], -away[:, 0])), normals

    def deepest_in(self, pose: NDArray[np.float64], other: 'Interior', place: NDArray[np.float64]
                   ) -> Contact:
        """The deepest point of this object at `pose` (4, 4) in another at `place` (4, 4)."""
        to_other = np.linalg.inv(place) @ pose
        points = self.samples @ to_other[:3, :3].T + to_other[:3, 3]
        near = (points ** 2).sum(axis=1) < other.radius ** 2
        if not near.any():
            return _APART
        depths, normals = other.depths(points[near])
        deepest = int(depths.argmax())
        way = place[:3, :3] @ normals[deepest]
        back = -(pose[:3, :3] @ self.sample_normals[near][deepest])
        # A point that is deeper than the middle would leave on the other side.
        return Contact(float(depths[deepest]),
                       place[:3, :3] @ points[near][deepest] + place[:3, 3],
                       way if way @ back >= 0 else back)


def contact(first: Interior, pose: NDArray[np.float64], second: Interior,
            place: NDArray[np.float64]) -> Contact:
    """The deepest contact of two objects at poses (4, 4)."""
    if np.linalg.norm(pose[:3, 3] - place[:3, 3]) >= first.radius + second.radius:
        return _APART
    one, two = first.deepest_in(pose, second, place), second.deepest_in(place, first, pose)
    return one if one.depth >= two.depth else Contact(two.depth, two.place, -two.normal)


@dataclass(frozen=True)
class PlacedObject:
    """An object at a pose (4, 4), and the covariance (6, 6) of that pose [m, rad]."""

    interior: Interior
    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @classmethod
    def from_estimate(cls, interior: Interior, estimate: PoseEstimate, symmetry: Symmetry
                      ) -> 'PlacedObject':
        """Where an object of this symmetry was found: turning about its axis changes nothing."""
        basis = symmetry.tangent_basis(estimate.pose)
        across = basis @ basis.T
        return cls(interior, estimate.pose, across @ estimate.covariance @ across)


@dataclass(frozen=True)
class Resolution:
    """Changes of poses that resolve penetration.

    deviations: (n, 6) tangent vectors (`se3.retract`) [m, rad]. cost: half their squared
    Mahalanobis distance by the poses' covariances [nat]. depth: of the deepest pair that remains
    [m]. pair: its indices; empty for fewer than two objects.
    """

    deviations: NDArray[np.float64]
    cost: float
    depth: float
    pair: tuple[int, ...]


def outside_of(interior: Interior, others: Sequence[tuple[Interior, NDArray[np.float64]]]
               ) -> Callable[[NDArray[np.float64]], NDArray[np.bool_]]:
    """Which poses (n, 4, 4) of an object are outside of others at poses (4, 4), as a function.

    Inscribed balls must not overlap. It is a necessary condition, and quickly checked.
    """
    middles = [(other, pose[:3, :3] @ other.core + pose[:3, 3]) for other, pose in others]

    def outside(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        centres = poses[:, :3, :3] @ interior.core + poses[:, :3, 3]
        possible = np.ones(len(poses), bool)
        for other, middle in middles:
            away = np.linalg.norm(centres - middle, axis=1)
            possible &= away > _BALLS * (interior.core_radius + other.core_radius)
        return possible
    return outside


def resolve_penetration(objects: Sequence[PlacedObject], most: float = np.inf) -> Resolution:
    """Move objects until no two penetrate each other deeper than 1 mm.

    Each iteration moves the deepest pair so that its deepest point leaves the other object, by the
    least squared Mahalanobis distance: a projection on the linearized constraint.
    most: stop where the cost is larger [nat].
    """
    poses = np.array([each.pose for each in objects]).reshape(-1, 4, 4)
    deviations = np.zeros((len(objects), 6))
    contacts: dict[tuple[int, ...], Contact] = {
        pair: _contact(objects, poses, *pair) for pair in combinations(range(len(objects)), 2)}
    if not contacts:
        return Resolution(deviations, 0.0, -np.inf, ())
    for _ in range(_ITERATIONS):
        first, second = max(contacts, key=lambda pair: contacts[pair].depth)
        deepest = contacts[first, second]
        if deepest.depth <= _RESIDUAL:
            break
        gradients = {k: sign * np.concatenate([
            deepest.normal, np.cross(deepest.place - poses[k, :3, 3], deepest.normal)])
            for k, sign in ((first, 1.0), (second, -1.0))}
        directions = {k: objects[k].covariance @ gradient for k, gradient in gradients.items()}
        gain = sum(float(gradients[k] @ directions[k]) for k in gradients)
        # A little farther than the linear constraint asks for: surfaces are curved.
        wanted = deepest.depth - 0.5 * _RESIDUAL
        for k, direction in directions.items():
            step = direction * wanted / gain
            deviations[k] += step
            poses[k] = retract(objects[k].pose, deviations[k][None])[0]
        if _cost(objects, deviations) > most:
            break
        for pair in contacts:
            if first in pair or second in pair:
                contacts[pair] = _contact(objects, poses, *pair)
    last = max(contacts, key=lambda pair: contacts[pair].depth)
    return Resolution(deviations, _cost(objects, deviations), contacts[last].depth, last)


def deepest_penetration(objects: Sequence[tuple[Interior, NDArray[np.float64]]]) -> float:
    """Depth [m] of the deepest pair of objects at poses (4, 4); 0 without penetration."""
    return max([0.0, *(contact(*one, *other).depth for one, other in combinations(objects, 2))])


def _contact(objects: Sequence[PlacedObject], poses: NDArray[np.float64], first: int, second: int
             ) -> Contact:
    return contact(objects[first].interior, poses[first], objects[second].interior, poses[second])


def _cost(objects: Sequence[PlacedObject], deviations: NDArray[np.float64]) -> float:
    """Half the sum of squared Mahalanobis distances [nat]."""
    total = 0.0
    for each, deviation in zip(objects, deviations, strict=True):
        # Metres and radians differ in size; the covariance is singular about an axis of symmetry.
        total += float(deviation @ np.linalg.pinv(each.covariance, 1e-12) @ deviation)
    return 0.5 * total
