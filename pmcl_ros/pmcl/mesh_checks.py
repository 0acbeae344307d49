"""What a mesh has that a search suffers from: told when it is loaded."""

import logging

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pmcl_ros.geometry.moved_surface import Surface
from pmcl_ros.runtime.errors import ObjectModelError
from pmcl_ros.runtime.mesh_repair import boundary_share, is_apart

_LOG = logging.getLogger(__name__)
_MANY_FACES, _ENOUGH = 100_000, 20_000  # a search takes minutes; so many tell the same
_SIMPLIFY = ("python3 -c \"import trimesh; trimesh.load('mesh.stl', force='mesh')."
             f'simplify_quadric_decimation(face_count={_ENOUGH}).export(\'simple.stl\')"')
_BIT = 0.01  # of the area of the largest part: less is dust in a scan, a cap is more
_NO_BALL = 0.05  # share of its radius by which the surface of no ball differs less
_FARTHEST = 10  # diagonals: of the origin from the middle of the mesh


def check_declared(mesh: trimesh.Trimesh, motions: NDArray[np.float64], what: str, name: str
                   ) -> None:
    """Warn if declared motions move the surface: that may be meant, as with a small mark."""
    off = Surface.from_mesh(mesh).moved_by(motions)
    if off > 0.02 * float(np.linalg.norm(mesh.extents)):
        _LOG.warning('object %r: its declared %s its surface by up to %.1f mm; poses that far '
                     'apart count as one', name, what, 1e3 * off)


def check_ball(mesh: trimesh.Trimesh, name: str) -> None:
    """Warn of what looks the same from all sides: no list of symmetries here can say that."""
    points = np.concatenate([mesh.vertices, mesh.triangles_center])
    radii = np.linalg.norm(points - mesh.bounds.mean(axis=0), axis=1)
    if np.ptp(radii) < _NO_BALL * radii.max():
        _LOG.warning('object %r: it is a ball, whose orientation nothing tells and no symmetry '
                     'here can declare: it may be lost where it is in plain view', name)


def check_scan(mesh: trimesh.Trimesh, name: str) -> None:
    """Warn of what scans bring along and a search suffers from: many faces, holes, loose bits, a
    far origin.

    Raises ObjectModelError for an origin so far away that poses about it say nothing.
    """
    if len(mesh.faces) > _MANY_FACES:
        _LOG.warning('object %r: %d faces make a search take minutes, %d are enough; simplify the '
                     'mesh, with the name of its file for mesh.stl: %s', name, len(mesh.faces),
                     _ENOUGH, _SIMPLIFY)
    share = boundary_share(mesh)
    if share:
        _LOG.warning('object %r: its mesh is not closed, %d %% of the edges belong to one face '
                     'only%s', name, max(1, round(100 * share)),
                     ', as where faces share no corners: merge close vertices' if is_apart(mesh)
                     else '; close holes of a scan, their rims count as outlines')
    if not is_apart(mesh):
        _tell_bits(mesh, name)
    middle = mesh.bounds.mean(axis=0)
    far, place = float(np.linalg.norm(middle)), (middle.round(5) + 0).tolist()
    diagonal = float(np.linalg.norm(mesh.extents))
    if far > _FARTHEST * diagonal:
        raise ObjectModelError(f'object {name!r}: its origin is {far:.3g} m from the middle of '
                               f'its mesh, which measures {diagonal:.3g} m; move it into the '
                               f'mesh, to {place} in metres say')
    if far > diagonal:
        _LOG.warning('object %r: its origin is %.3g m from the middle of its mesh, which measures '
                     '%.3g m; region and pose are those of the origin: better move it into the '
                     'mesh, to %s in metres say', name, far, diagonal, place)


def _tell_bits(mesh: trimesh.Trimesh, name: str) -> None:
    """Warn of small parts outside the box of the largest one, as of dust in a scan."""
    links = coo_array((np.ones(len(mesh.edges)), mesh.edges.T), shape=2 * [len(mesh.vertices)])
    part = connected_components(links, directed=False)[1][mesh.faces[:, 0]]
    areas = np.bincount(part, mesh.area_faces)
    if len(areas) == 1:
        return
    low, high = np.full((len(areas), 3), np.inf), np.full((len(areas), 3), -np.inf)
    np.minimum.at(low, part, mesh.triangles.min(axis=1))
    np.maximum.at(high, part, mesh.triangles.max(axis=1))
    most = areas.argmax()
    outside = ((high < low[most]) | (low > high[most])).any(axis=1)
    bits = np.flatnonzero(outside & (areas < _BIT * areas[most]))
    if len(bits):
        sizes = (high - low).max(axis=1)
        largest = bits[sizes[bits].argmax()]
        place = ', '.join(f'{each:.3g}' for each in (low + high)[largest] / 2)
        _LOG.warning('object %r: loose parts count as parts of it: %d of up to %.2g m, the '
                     'largest at (%s) m; delete those that are none', name, len(bits),
                     sizes[largest], place)
