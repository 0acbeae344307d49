"""An object as a rigid body for MuJoCo: convex pieces, and the inertia of a shell."""

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.manipulation.fetch_arm import FIXED, OBJECT, ROBOT
from pmcl_ros.simulation.manipulation.physics import mujoco

NAME = 'object'
_BULGE = 0.002  # m: by which a convex hull may stand out of the mesh
_THIN = 0.003  # m: pieces are no thinner
_SLIDES = 0.4, 0.005, 0.0003  # friction: sliding, of turns [m], rolling [m]


def add_object(spec: Any, model: ObjectModel, mass: float, low: float | None) -> None:
    """A free body for the object, with the inertia of a thin shell.

    mass [kg]. low: height of its centre of mass in the mesh [m], None: that of the shell.
    """
    mj = mujoco()
    body = spec.worldbody.add_body(name=NAME)
    body.add_freejoint(name=NAME)
    centre, inertia = shell(model, mass)
    if low is not None:
        centre[2] = low
    body.mass, body.ipos, body.explicitinertial = mass, centre, True
    body.fullinertia = [inertia[i, j] for i, j in
                        ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    for number, points in enumerate(convex_pieces(model)):
        name = f'{NAME}_{number}'
        hull = ConvexHull(points)
        mesh = spec.add_mesh(name=name, uservert=hull.points[hull.vertices].ravel())
        mesh.inertia = mj.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        body.add_geom(name=name, type=mj.mjtGeom.mjGEOM_MESH, meshname=name, contype=OBJECT,
                      conaffinity=ROBOT | FIXED, condim=6, friction=_SLIDES, mass=0.0,
                      rgba=(0.6, 0.85, 0.9, 0.6))


def shell(model: ObjectModel, mass: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centre (3,) [m] and inertia (3, 3) about it [kg m^2] of a mass spread over the surface."""
    corners = model.vertices[model.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
                           axis=1) / 2
    share = mass * areas / areas.sum()
    centre = share @ corners.mean(axis=1) / mass
    points = corners - centre
    # The integral of x x^T over a triangle is A / 12 (sum of its corners' v v^T + s s^T), s their
    # sum.
    total = points.sum(axis=1)
    second = (np.einsum('f,fvi,fvj->ij', share, points, points)
              + np.einsum('f,fi,fj->ij', share, total, total)) / 12
    return centre, np.trace(second) * np.eye(3) - second


def convex_pieces(model: ObjectModel) -> list[NDArray[np.float64]]:
    """Points (n, 3) of each piece, whose hulls together stand out of the mesh by a little only.

    The mesh is cut along z at heights of its vertices, where the hull would stand out most.
    """
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
    return _pieces(mesh, model.vertices[:, 2].min(), model.vertices[:, 2].max())


def _pieces(mesh: trimesh.Trimesh, low: float, high: float) -> list[NDArray[np.float64]]:
    """Of the part of a mesh between two heights."""
    inside = mesh.vertices[(mesh.vertices[:, 2] >= low) & (mesh.vertices[:, 2] <= high)]
    points = np.concatenate([inside, _outline(mesh, low), _outline(mesh, high)])
    hull = ConvexHull(points)
    deep = -(hull.equations[:, :3] @ points.T + hull.equations[:, 3:]).max(axis=0)
    heights = points[:, 2]
    cuttable = (heights > low + _THIN) & (heights < high - _THIN)
    if not cuttable.any() or deep[cuttable].max() < _BULGE:
        return [points]
    cut = float(heights[cuttable][deep[cuttable].argmax()])
    return _pieces(mesh, low, cut) + _pieces(mesh, cut, high)


def _outline(mesh: trimesh.Trimesh, height: float) -> NDArray[np.float64]:
    """(n, 3) points of the mesh's cut at a height."""
    cut = trimesh.intersections.mesh_plane(  # type: ignore[no-untyped-call]
        mesh, [0, 0, 1], [0, 0, height])
    return np.asarray(cut, float).reshape(-1, 3)
