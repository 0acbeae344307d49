"""Vessels from any closed mesh of their outside: the surface of their cavity."""

import logging
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import ObjectModelError
from pmcl_ros.simulation.described.geometry_kernel import manifold

_LOG = logging.getLogger(__name__)

_LID = 5e-4  # m: a lid's corners lie this close to the height of the mouth
_LEVEL = 0.9  # and its normal has at least this part along z
_FLAT = 4e-4  # least eigenvalue of what fixes a corner, over the largest: faces within some 2 deg
_OFF = 0.2  # of the wall: by which a face may miss its distance
_LIFT = 1e-5  # m: a given cavity reaches so far beyond the mouth
_MOST = 30_000  # faces of a mesh that is eroded: that takes 1.5 GB, and minutes:
_SECONDS = 0.005  # a face
_MANY = 5000  # a mesh of more faces is simplified first
_SIMPLER = 0.01  # of the wall: surfaces move by less then
_MEAN = 1.008  # of a polyhedron's radius: it stands for a ball whose radius is within 0.8 %
_FAR = 10.0  # m
_POKES = 1e-3  # of the cavity's volume: outside of the body
_NOTHING = 1e-6  # of it: in what is left of the body
_GIVE = 'give its inner surface instead: inner: inner.stl'
_COARSE = 0.2  # of the wall: by which a cavity may move to find its handles
_FIRST = 0.25  # of the wall: radius of a ball that gets through all handles
_STEP = 1.5  # ratio of the radii of two balls that are tried in these
_ENDS = 1.6  # by which a handle may be wider at its ends
_THICK = 0.55  # of the radius of a ball that a handle stops: a ball that has room in it, not in
# what the wider ball leaves of an edge or corner of the cavity
_OVER = 0.02  # of the wall: by which a handle reaches into the wall around it
_AT_MOST = 0.3  # of the cavity: larger handles are a part of the vessel


def cavity_of(outer: trimesh.Trimesh, wall: float, mouth: float | None) -> trimesh.Trimesh:
    """The surface that lies a wall [m] inside of a closed mesh.

    mouth: height z of its lid [m], which the cavity reaches beyond; None: there is none. Handles
    that go around a hole are massive. Raises ObjectModelError where no lid is found or no cavity
    is left.
    """
    _lid(outer, mouth)
    moved = _moved(outer, wall, mouth)
    if moved is None:
        # At sharp edges, faces narrower than the wall turn over; a simpler mesh has none there.
        moved = _moved(_mesh(_solid(outer).simplify(_SIMPLER * wall)), wall, mouth)
    return _without_handles(_eroded(outer, wall, mouth) if moved is None else moved, wall)


def _moved(outer: trimesh.Trimesh, wall: float, mouth: float | None) -> trimesh.Trimesh | None:
    """The mesh with all faces moved inwards, a lid outwards: corners go to where their faces meet
    again, by least squares. None where faces then overlap or miss their distance.
    """
    away = np.full(len(outer.faces), -wall)
    away[_lid(outer, mouth)] = wall
    normals = np.asarray(outer.face_normals)
    weights = np.asarray(outer.face_angles).ravel()
    corner, face = outer.faces.ravel(), np.repeat(np.arange(len(outer.faces)), 3)
    normal = normals[face]
    square, right = np.zeros((len(outer.vertices), 3, 3)), np.zeros((len(outer.vertices), 3))
    np.add.at(square, corner, (weights[:, None] * normal)[:, :, None] * normal[:, None])
    np.add.at(right, corner, (weights * away[face])[:, None] * normal)
    move = np.einsum('nij,nj->ni', np.linalg.pinv(square, _FLAT, hermitian=True), right)
    inner = trimesh.Trimesh(outer.vertices + move, outer.faces, process=False)
    off = np.abs((normal * move[corner]).sum(axis=1) - away[face]).max()
    across = np.cross(inner.triangles[:, 1] - inner.triangles[:, 0],
                      inner.triangles[:, 2] - inner.triangles[:, 0])
    if off > _OFF * wall or ((across * normals).sum(axis=1) < 0).any():
        return None
    return inner


def _eroded(outer: trimesh.Trimesh, wall: float, mouth: float | None) -> trimesh.Trimesh:
    """The points of a body about which a ball of the wall's radius fits into it.

    For roundings that are narrower than the wall. Above the mouth the body goes straight on, and
    below it by a wall, so that a round rim does not matter.
    """
    kernel = manifold()
    body, ball = _solid(outer), _ball(2, _MEAN * wall)
    if body.num_tri() > _MANY:
        body = body.simplify(_SIMPLER * wall)
    faces = body.num_tri()
    if faces > _MOST:
        raise ObjectModelError(f'its mesh has roundings that are narrower than the wall, and '
                               f'{faces} faces, simplified by {1e3 * _SIMPLER * wall:.2g} mm; at '
                               f'most {_MOST} can be hollowed: simplify it, or {_GIVE}')
    if faces > _MANY:
        _LOG.info('hollowing a mesh of %d faces, about %.0f s', faces, _SECONDS * faces)
    if mouth is not None:
        start = mouth - wall
        neck = body.slice(start).extrude(3 * wall).translate((0, 0, start))
        body = body.trim_by_plane((0, 0, -1), -start) + neck
    found = body.minkowski_difference(ball)
    parts = [each for each in found.decompose() if mouth is None
             or each.bounding_box()[5] > mouth]
    if not parts:
        raise ObjectModelError(f'a wall of {wall:g} m leaves no cavity; {_GIVE}')
    return _mesh(max(parts, key=kernel.Manifold.volume))


def _without_handles(cavity: trimesh.Trimesh, wall: float) -> trimesh.Trimesh:
    """A cavity [m] less its ways around a hole, as of a mug's handle.

    A ball that is too large for the handles, by the factor by which these may be wider at their
    ends, shows them. A cavity without, or of which they are no small part, as of a ring, stays as
    it is.
    """
    kernel, whole = manifold(), _solid(cavity)
    if whole.genus() <= 0:
        return cavity
    coarse, radius = whole.simplify(_COARSE * wall), _FIRST * wall
    core = coarse
    while core.genus() > 0:
        radius *= _STEP
        core = _room(coarse, radius)
        if core.is_empty():
            return cavity
    wide = _room(coarse, _ENDS * radius)
    core, ball = (core, radius) if wide.is_empty() else (wide, _ENDS * radius)
    # A ball wider than the core's is sure to cover the walls of what is no handle.
    covered = core.simplify(_COARSE * wall).minkowski_sum(_ball(1, ball + 2 * _COARSE * wall))
    handles = [each for each in (whole - covered).decompose()
               if not each.minkowski_difference(_ball(1, _THICK * radius)).is_empty()]
    if sum(each.volume() for each in handles) > _AT_MOST * whole.volume():
        return cavity
    for each in handles:
        whole -= each.minkowski_sum(_ball(0, _OVER * wall))
    _LOG.info('its handle is taken as massive; where it is hollow, %s', _GIVE)
    return _mesh(max(whole.decompose(), key=kernel.Manifold.volume))


def _room(cavity: Any, radius: float) -> Any:
    """Where the middle of a ball can be, the largest part; empty where it is not at the top."""
    kernel = manifold()
    parts = cavity.minkowski_difference(_ball(1, radius)).decompose()
    room = max(parts, key=kernel.Manifold.volume, default=kernel.Manifold())
    at_top = not room.is_empty() and (
        room.bounding_box()[5] > cavity.bounding_box()[5] - _STEP * radius)
    return room if at_top else kernel.Manifold()


def _ball(fineness: int, radius: float) -> Any:
    return _solid(trimesh.creation.icosphere(fineness, radius))


def _solid(mesh: trimesh.Trimesh) -> Any:
    kernel = manifold()
    return kernel.Manifold(kernel.Mesh64(np.array(mesh.vertices, float),
                                         np.array(mesh.faces, np.uint64)))


def _mesh(solid: Any) -> trimesh.Trimesh:
    mesh = solid.to_mesh64()
    return trimesh.Trimesh(mesh.vert_properties, mesh.tri_verts, process=False)


def lifted(inner: trimesh.Trimesh, mouth: float | None) -> trimesh.Trimesh:
    """A given cavity, its lid a little above the mouth so that no film of material stays there."""
    vertices = np.array(inner.vertices)
    vertices[np.unique(inner.faces[_lid(inner, mouth)]), 2] += _LIFT
    return trimesh.Trimesh(vertices, inner.faces, process=False)


def _lid(mesh: trimesh.Trimesh, mouth: float | None) -> NDArray[np.bool_]:
    """Which faces close the mouth."""
    if mouth is None:
        return np.zeros(len(mesh.faces), bool)
    near = (np.abs(mesh.triangles[:, :, 2] - mouth) < _LID).all(axis=1)
    lid = near & (mesh.face_normals[:, 2] > _LEVEL)
    if not lid.any():
        raise ObjectModelError(f'no level face of the mesh closes the mouth at {mouth:g} m: write '
                               f'mouth: {{z: {mesh.bounds[1, 2]:.4g}, open: true}}, or add a lid '
                               'to the mesh')
    return np.asarray(lid)


def united(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A closed mesh with its bodies, which may overlap, made one, less its cavities.

    Raises ObjectModelError where that fails.
    """
    bodies = mesh.split(only_watertight=False)
    solid = [each for each in bodies if each.volume > 0]
    if len(solid) < 2:
        return mesh
    cavities = [each for each in bodies if each.volume < 0]
    for each in cavities:
        each.invert()
    kernel = manifold()
    body, empty = (kernel.Manifold.batch_boolean([_solid(each) for each in parts],
                                                 kernel.OpType.Add)
                   for parts in (solid, cavities))
    made = _mesh(body - empty)
    if not made.is_volume:
        raise ObjectModelError('its parts overlap: unite them')
    return made


def above(mesh: trimesh.Trimesh, height: float) -> trimesh.Trimesh:
    """The part of a closed mesh above a height z [m]."""
    return _cut(mesh, height, height + _FAR)


def below(mesh: trimesh.Trimesh, height: float) -> trimesh.Trimesh:
    """The part of a closed mesh below a height z [m]."""
    return _cut(mesh, height - _FAR, height)


def _cut(mesh: trimesh.Trimesh, low: float, high: float) -> trimesh.Trimesh:
    box = trimesh.creation.box(bounds=[[-_FAR, -_FAR, low], [_FAR, _FAR, high]])
    return _boolean('intersection', mesh, box)


def without(body: trimesh.Trimesh, cavity: trimesh.Trimesh, mouth: float | None
            ) -> trimesh.Trimesh:
    """A closed body less a cavity, which lies in it but at the mouth.

    Raises ObjectModelError where it does not, or where nothing is left.
    """
    inside = cavity if mouth is None else below(cavity, mouth)
    outside = _boolean('difference', inside, body)
    poking = 0.0 if outside.is_empty else float(outside.volume)
    if not inside.volume > 0 or poking > _POKES * inside.volume:
        raise ObjectModelError(f'the cavity, {1e6 * inside.volume:.4g} ml, lies partly outside of '
                               f'the mesh: check wall and scale, or {_GIVE}')
    left = _boolean('difference', body, cavity)
    if left.is_empty or not left.volume > _NOTHING * inside.volume:
        raise ObjectModelError('the cavity leaves no wall: is the inner surface the outer one?')
    return left


def _boolean(kind: str, one: trimesh.Trimesh, other: trimesh.Trimesh) -> trimesh.Trimesh:
    manifold()
    make = {'difference': trimesh.boolean.difference, 'intersection': trimesh.boolean.intersection}
    return make[kind]([one, other], engine='manifold', check_volume=False)
