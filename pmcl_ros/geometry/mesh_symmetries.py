"""Which rigid motions leave the surface of a mesh as it is, beside turns about an axis."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.moved_surface import Surface
from pmcl_ros.geometry.revolution_axis import SAME, principal_axes
from pmcl_ros.geometry.se3 import pose_of, rotation_angle
from pmcl_ros.geometry.symmetry import symmetry_group
from pmcl_ros.runtime.errors import ObjectModelError

_FOLDS = 9, 8, 7, 6, 5, 4, 3, 2  # parts of a full turn: a prism of more sides is round
_ALL = 9 * 8 * 7 * 5  # a fold of which all of them are divisors
_APART = 0.04  # rad: what is found nearer to a known rotation is that, less exactly
_LEAST = 0.4  # rad: turns of a prism of 15 sides, the last that is told not to be quite round
_ONE_LINE = 0.9998  # cosine: of directions 1 degree apart, one is tried
_FAR = 0.98  # share of the largest distance from the middle: vertices that are corners
_CORNERS, _NORMALS = 8, 20  # directions of each kind that are tried
_MANY = 500  # vertices and faces among which these are looked for


def discrete_symmetries(mesh: trimesh.Trimesh, axis: NDArray[np.float64] | None, name: str
                        ) -> NDArray[np.float64]:
    """(k, 4, 4) the group of rigid motions [m] that leave a mesh as it is, the identity first.

    mesh: in metres. axis: (3,) unit vector through the origin, about which it is rotationally
        symmetric: half a turn across it may be found beside. None: turns about axes through the
        centroid, along principal axes, corners, between two of these, and along normals of faces.
    They take points of the surface off it by 0.5 % of the diagonal at most; those that move it
    least count where others make no group with them. Raises ObjectModelError, with the name, of
    what is round without an axis being told.
    """
    vertices = np.asarray(mesh.vertices, np.float64)
    reach = float(np.linalg.norm(vertices, axis=1).max())
    found = _across(mesh, axis) if axis is not None else _about_centroid(mesh, name)
    generators: list[list[float]] = []
    group = symmetry_group([], axis, 1.0, reach, name)
    for motion in found:
        if rotation_angle(group, motion).min() <= _APART:
            continue
        try:
            larger = symmetry_group([*generators, motion.ravel().tolist()], axis, 1.0, reach, name)
        except ObjectModelError:
            continue  # it is none, but of a mesh that is nearly more symmetric than it is
        if rotation_angle(larger[1:], larger[0]).min() >= _LEAST:
            generators.append(motion.ravel().tolist())
            group = larger
    return group


def _across(mesh: trimesh.Trimesh, axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """(0 or 1, 4, 4) half a turn that reverses the axis of a surface of revolution.

    About the line from the middle of the axis to the farthest corner: of a prism with many sides
    it takes corners to corners.
    """
    vertices = np.asarray(mesh.vertices, np.float64)
    heights, direction = vertices @ axis, _farthest_aside(vertices, axis)
    turn = Rotation.from_rotvec(np.pi * direction / np.linalg.norm(direction)).as_matrix()
    motion = pose_of(turn, (heights.min() + heights.max()) * axis)[None]
    limit = _limit(mesh)
    return motion[:int(Surface.from_mesh(mesh).moved_by(motion, limit) <= limit)]


def _farthest_aside(places: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) from an axis through the origin to the farthest of places (n, 3), across it."""
    aside = places - (places @ axis)[:, None] * axis
    return np.asarray(aside[np.linalg.norm(aside, axis=1).argmax()])


def _about_centroid(mesh: trimesh.Trimesh, name: str) -> list[NDArray[np.float64]]:
    """Turns (4, 4) about axes through the centroid, those first that move the surface least."""
    surface, limit = Surface.from_mesh(mesh), _limit(mesh)
    middle, principal = principal_axes(mesh)
    found = []
    for direction in _candidates(mesh, middle, principal):
        fold = 1  # the highest one; it implies its divisors
        for each in _FOLDS:
            if fold % each == 0:
                continue
            turn = Rotation.from_rotvec(2 * np.pi / each * direction).as_matrix()
            motion = pose_of(turn, middle - turn @ middle)
            if (moved := surface.moved_by(motion[None], limit)) <= limit:
                found.append((moved, motion))
                fold *= each
        if fold == _ALL:
            raise ObjectModelError(f'object {name!r}: any turn about {direction.round(3).tolist()}'
                                   ' leaves its mesh as it is: it is round')
    return [motion for _, motion in sorted(found, key=lambda each: each[0])]


def _limit(mesh: trimesh.Trimesh) -> float:
    """How far a symmetry may take the surface off itself [m]."""
    return SAME * float(np.linalg.norm(mesh.extents))


def _candidates(mesh: trimesh.Trimesh, middle: NDArray[np.float64],
                principal: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) unit vectors along which an axis of symmetry may be."""
    away = np.asarray(mesh.vertices, np.float64) - middle
    distances = np.linalg.norm(away, axis=1)
    farthest = np.argsort(-distances, kind='stable')[:_MANY]
    farthest = farthest[distances[farthest] > _FAR * distances.max()]
    corners = _unique_lines(away[farthest])[:_CORNERS]
    first, second = np.triu_indices(len(corners), 1)
    between = np.concatenate([corners[first] + corners[second], corners[first] - corners[second]])
    largest = np.argsort(-mesh.area_faces, kind='stable')[:_MANY]
    normals = _unique_lines(np.asarray(mesh.face_normals, np.float64)[largest])[:_NORMALS]
    aside = [_farthest_aside(away, each) for each in principal]
    return _unique_lines(np.concatenate([principal, corners, normals, between, aside]))


def _unique_lines(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m, 3) unit vectors of (n, 3), the first of those that are along one line."""
    lengths = np.linalg.norm(directions, axis=1)
    units = directions[lengths > 0] / lengths[lengths > 0, None]
    free, kept = np.ones(len(units), bool), []
    while free.any():
        unit = units[int(free.argmax())]
        kept.append(unit)
        free &= np.abs(units @ unit) < _ONE_LINE
    return np.array(kept).reshape(-1, 3)
