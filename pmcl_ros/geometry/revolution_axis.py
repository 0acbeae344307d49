"""Which axis a mesh is a surface of revolution about."""

import logging
from collections.abc import Iterator

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

ANGLES = 0.5, 1.3, 2.1, 3.0  # rad: by which a surface of revolution is turned to be known as one
_LOG = logging.getLogger(__name__)
_MOST_POINTS, _OUT_OF_ROUND = 0.9, 0.02  # share of a round surface; of its radius, it may be off


def revolution_axis(mesh: trimesh.Trimesh, name: str) -> NDArray[np.float64] | None:
    """(3,) the axis through the origin about which turning the surface leaves it as it is.

    mesh: in metres. None: there is no such axis.

    z, x and y are tried first: the surface may be off by 2 % of its diagonal. Then the principal
    axes of the surface are tried: most of it must also be within 2 % of its radius, as a square
    rod is not. Warns of an axis that is not through the origin. name: of the object, for that.
    """
    points, surface, noise = surface_of(mesh)
    tolerance = noise + 0.01 * float(np.linalg.norm(mesh.extents))
    usual = np.quantile(surface.query(points)[0], _MOST_POINTS)

    def off(axis: NDArray[np.float64], through: NDArray[np.float64]
            ) -> Iterator[NDArray[np.float64]]:
        for angle in ANGLES:
            turned = Rotation.from_rotvec(angle * axis).apply(points - through) + through
            yield surface.query(turned)[0]

    def is_round(axis: NDArray[np.float64], through: NDArray[np.float64]) -> bool:
        radius = np.linalg.norm(np.cross(points - through, axis), axis=1).max()
        return all(each.max() < tolerance
                   and np.quantile(each, _MOST_POINTS) < usual + _OUT_OF_ROUND * radius
                   for each in off(axis, through))

    middle, principal = _principal_axes(mesh)
    for axis in np.eye(3)[[2, 0, 1]]:
        if all(each.max() < tolerance for each in off(axis, np.zeros(3))):
            return np.asarray(axis)
    for axis in principal:
        if is_round(axis, np.zeros(3)):
            return np.asarray(axis)
        if is_round(axis, middle):
            beside = (middle - (middle @ axis) * axis).round(5) + 0
            _LOG.warning(
                'object %r: it is rotationally symmetric about %s, but %.3g m beside the origin, '
                'so that poses which look the same count as others and it may be lost; move the '
                'origin to %s in metres', name, (axis.round(4) + 0).tolist(),
                np.linalg.norm(beside), beside.tolist())
    return None


def _principal_axes(mesh: trimesh.Trimesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The middle (3,) of the surface and its principal axes (3, 3), in rows."""
    corners, areas = mesh.triangles, mesh.area_faces / mesh.area
    middle = areas @ corners.mean(axis=1)
    corners = corners - middle
    # The integral of x x^T over a triangle is area / 12 (sum of v v^T + (sum of v)(sum of v)^T).
    total = corners.sum(axis=1)
    moments = (np.einsum('n,nki,nkj->ij', areas, corners, corners)
               + np.einsum('n,ni,nj->ij', areas, total, total)) / 12
    axes = np.linalg.eigh(moments)[1].T
    largest = np.take_along_axis(axes, abs(axes).argmax(axis=1)[:, None], axis=1)
    return middle, np.asarray(axes * np.sign(largest))


def moved_by(mesh: trimesh.Trimesh, motions: NDArray[np.float64]) -> tuple[float, float]:
    """How far motions (n, 4, 4) take points of a surface off it, and how exactly this tells [m].
    """
    points, surface, noise = surface_of(mesh)
    return max(float(surface.query(points @ each[:3, :3].T + each[:3, 3])[0].max())
               for each in motions) - noise, noise


def surface_of(mesh: trimesh.Trimesh) -> tuple[NDArray[np.float64], cKDTree, float]:
    """Points (n, 3) of the surface, others to be the nearest of, and how near those are [m]."""
    points = trimesh.sample.sample_surface(mesh, 4000, seed=0)[0]
    surface = cKDTree(trimesh.sample.sample_surface(mesh, 20000, seed=1)[0])
    return points, surface, float(surface.query(points)[0].max())
