"""Which axis a mesh is a surface of revolution about."""

import logging

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.geometry.moved_surface import Surface
from pmcl_ros.geometry.se3 import rotations_about

ANGLES = 0.5, 1.3, 2.1, 3.0  # rad: by which a surface of revolution is turned to be known as one
_LOG = logging.getLogger(__name__)
# Shares of the largest radius by which a surface of revolution may be off itself, and by which it
# is told: regular prisms of 10 sides and more may, those of up to 15 are told.
_OUT_OF_ROUND, _TOLD = 0.05, 0.02
# Share of the diagonal within which symmetries are told apart: what is slender, a pencil say, is
# round as far as anybody can tell.
SAME = 0.005


def revolution_axis(mesh: trimesh.Trimesh, name: str) -> NDArray[np.float64] | None:
    """(3,) the axis through the origin about which turning the surface leaves it as it is.

    mesh: in metres. None: there is no such axis.

    z, x and y are tried first, then the principal axes of the surface. The surface turned about
    the axis may be off itself by 5 % of its largest radius, or by 0.5 % of its diagonal. Warns
    where that is more than 2 % of the radius, and of an axis that is not through the origin. name:
    of the object, for that.
    """
    surface = Surface.from_mesh(mesh)
    middle, principal = principal_axes(mesh)
    same = SAME * float(np.linalg.norm(mesh.extents))

    def off(axis: NDArray[np.float64], through: NDArray[np.float64]) -> tuple[float, float]:
        """How far its turns are off it [m], infinite if too far; that as a share of the radius."""
        radius = float(np.linalg.norm(np.cross(surface.points - through, axis), axis=1).max())
        turns = rotations_about(axis, np.array(ANGLES))
        turns[:, :3, 3] = through - turns[:, :3, :3] @ through
        moved = surface.moved_by(turns, max(_OUT_OF_ROUND * radius, same))
        return moved, moved / radius

    for axis in [*np.eye(3)[[2, 0, 1]], *principal]:
        moved, share = off(axis, np.zeros(3))
        if not np.isfinite(moved):
            continue
        if share > _TOLD:
            _LOG.warning('object %r: turned about %s its surface is %.1f mm off itself; write '
                         'symmetries_continuous: [] if that matters', name, _named(axis),
                         1e3 * moved)
        return np.asarray(axis)
    for axis in principal:
        if np.isfinite(off(axis, middle)[0]):
            beside = (middle - (middle @ axis) * axis).round(5) + 0
            _LOG.warning(
                'object %r: it is rotationally symmetric about %s, but %.3g m beside the origin, '
                'so that poses which look the same count as others and it may be lost; move the '
                'origin to %s in metres', name, _named(axis), np.linalg.norm(beside),
                beside.tolist())
            break
    return None


def principal_axes(mesh: trimesh.Trimesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def _named(axis: NDArray[np.float64]) -> str:
    """x, y or z, else its components."""
    along = np.flatnonzero(axis == 1)
    return 'xyz'[along[0]] if len(along) else str((axis.round(4) + 0).tolist())
