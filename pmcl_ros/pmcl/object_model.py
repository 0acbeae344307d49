"""The object that is looked for: its mesh, and which motions leave it as it is."""

import io
import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.symmetry import Symmetry, symmetry_group
from pmcl_ros.pmcl.appearance import Appearance
from pmcl_ros.runtime.binary_file import read_bytes
from pmcl_ros.runtime.errors import FileError, ObjectModelError, PmclError
from pmcl_ros.runtime.mesh_size import MeshSize, mesh_size
from pmcl_ros.runtime.settings import Settings, read_yaml
from pmcl_ros.runtime.text_file import read_json

_LOG = logging.getLogger(__name__)
_SMALLEST, _LARGEST = 0.005, 5.0  # m: diagonals of what a robot can be asked to find on a table
_UNUSUAL = 1.0  # m: from here on a mesh in "metres" is asked about
_CENTIMETRES = 50.0  # units: a mesh larger than metres can be, but smaller than this, may be in cm
_MOST_FACES = 1_000_000
_MANY_FACES = 100_000
_MOST_POINTS, _OUT_OF_ROUND = 0.9, 0.02  # share of a round surface; of its radius, it may be off
_FARTHEST = 10  # diagonals: of the origin from the middle of the mesh
_MOST_BYTES = 2 ** 26
_KINDS = 'stl', 'obj', 'ply', 'off', 'glb'  # of meshes; trimesh reads others with more libraries
_DESCRIBED = '.yaml', '.yml'  # files of objects, which name a mesh
_Matrix = Annotated[tuple[float, ...], Field(min_length=16, max_length=16)]


class _ContinuousSymmetry(Settings):
    axis: tuple[float, float, float]
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ObjectSettings(Settings):
    """An object's YAML file. Symmetries as in BOP's models_info.json."""

    mesh: str = Field(description='path of the mesh, relative to this file')
    scale: float = Field(1.0, gt=0, description='metres per unit of the mesh; where it is left '
                         'out, a mesh that is far too large for metres is taken as millimetres')
    symmetries_continuous: list[_ContinuousSymmetry] | None = Field(
        None, max_length=1, description='axis (in the mesh frame) about which any rotation leaves '
        'the object as it is; an empty list: none; left out: found from the mesh')
    symmetries_discrete: list[_Matrix] = Field(
        [], description='rigid motions in the mesh frame that leave the object as it is: 4x4 '
        'matrices, each 16 numbers row by row, their translations in units of the mesh; those '
        'that follow from them need not be given')
    appearance: Appearance | None = Field(
        None, description='what the object is made of; simulated pictures need it, and of a clear '
        'object no depth of the surface is looked for')
    profile: list[tuple[float, float, float]] | None = Field(
        None, description='of a surface of revolution that pmcl profile has measured, from the '
        'bottom up: height, radius, standard deviation of the surface [m]; to be read by people')


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """A mesh and its symmetry.

    vertices: (n, 3) float64 [m], each of them in a face. faces: (m, 3) int64.
    axis: (3,) unit vector through the mesh's origin about which the object is rotationally
        symmetric, or None.
    closed: the mesh is watertight with outward faces.
    discrete: (k, 4, 4) as of `Symmetry`.
    clear: it is said to be of a clear material: its surface shows what is behind it.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    axis: NDArray[np.float64] | None
    closed: bool
    discrete: NDArray[np.float64] = field(default_factory=lambda: np.eye(4)[None])
    clear: bool = False

    @cached_property
    def symmetry(self) -> Symmetry:
        """All that leaves the object as it is."""
        return Symmetry(self.axis, self.discrete)

    @cached_property
    def radius(self) -> float:
        """Of the smallest sphere about the origin that holds the mesh [m]."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @cached_property
    def diameter(self) -> float:
        """Diagonal of the mesh's bounding box [m]."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @classmethod
    def load(cls, path: Path | str) -> 'ObjectModel':
        """Read a mesh file (STL, OBJ, PLY, OFF or GLB) or an object's YAML.

        Where no YAML says the unit of the mesh, it is guessed from its size, and told.
        Raises ObjectModelError when there is no such mesh, no surface in it, its unit cannot be
        guessed, or its size is impossible, SettingsError when the YAML cannot be read or says
        something impossible.
        """
        path = Path(path)
        settings = _described(path)
        mesh = read_mesh(path.parent / settings.mesh)
        scale = _scale_of(mesh, settings, path)
        if 'scale' not in settings.model_fields_set:
            _tell_size(mesh, scale, path)
        mesh.vertices *= scale
        return cls._from_mesh(mesh, path.stem, settings, scale)

    @classmethod
    def load_bop(cls, path: Path) -> 'ObjectModel':
        """Read models/obj_000001.ply of a BOP data set, in millimetres.

        Its symmetries are those of models_info.json beside it, else found from the mesh. Raises as
        `load`.
        """
        values: dict[str, Any] = {'mesh': path.name}
        info = path.with_name('models_info.json')
        if info.is_file():
            number = str(int(path.stem.removeprefix('obj_')))
            try:
                entry = read_json(info)[number]
                values |= {key: entry.get(key, []) for key in (
                    'symmetries_continuous', 'symmetries_discrete')}
            except FileError as error:
                raise ObjectModelError(str(error)) from None
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise ObjectModelError(f'{info} has no object {number}: {error!r}') from None
        mesh = read_mesh(path)
        mesh.vertices *= 0.001
        return cls._from_mesh(mesh, path.stem, ObjectSettings.make(values, str(info)), 0.001)

    @classmethod
    def _from_mesh(cls, mesh: trimesh.Trimesh, name: str, settings: ObjectSettings, scale: float
                   ) -> 'ObjectModel':
        """Of a mesh in metres; scale: metres per unit of its file."""
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
        diagonal = _diagonal(mesh)
        if not _SMALLEST <= diagonal <= _LARGEST:
            raise ObjectModelError(
                f'mesh {name!r} has a diagonal of {diagonal:.4g} m, expected {_SMALLEST} to '
                f'{_LARGEST} m; in an object YAML, scale says the metres per unit of the mesh: '
                '0.001 for millimetres')
        _check_scan(mesh, name)
        if settings.symmetries_continuous is not None:
            axis = _declared_axis(settings.symmetries_continuous, name)
        else:
            axis = _found_axis(mesh, name)
            _LOG.info('object %r: %s', name, 'no rotational symmetry found' if axis is None else
                      f'rotationally symmetric about {axis.tolist()}, found from its mesh')
        reach = float(np.linalg.norm(vertices, axis=1).max())
        discrete = symmetry_group(settings.symmetries_discrete, axis, scale, reach, name)
        _check_group(mesh, discrete, name)
        return cls(name, vertices, faces, axis, bool(mesh.is_volume), discrete,
                   settings.appearance is not None and settings.appearance.is_clear)


def mesh_file(path: Path | str) -> tuple[Path, float]:
    """The mesh file of an object, and metres per unit of it; raises as `ObjectModel.load`."""
    path = Path(path)
    settings = _described(path)
    mesh = path.parent / settings.mesh
    return mesh, _scale_of(read_mesh(mesh), settings, path)


def _described(path: Path) -> ObjectSettings:
    """An object's YAML; a mesh file is as one that names this mesh and says no more."""
    if path.suffix.lower() in _DESCRIBED:
        return ObjectSettings.make(read_yaml(path), str(path))
    return ObjectSettings(mesh=path.name)


def _scale_of(mesh: trimesh.Trimesh, settings: ObjectSettings, path: Path) -> float:
    """Metres per unit of a mesh: as it is said, else guessed; ObjectModelError where in doubt."""
    diagonal = _diagonal(mesh)
    if 'scale' in settings.model_fields_set or diagonal <= _LARGEST:
        return settings.scale
    if diagonal <= _CENTIMETRES:
        raise ObjectModelError(
            f'{path}: nothing says the unit of the mesh, whose diagonal of {diagonal:.4g} cannot '
            f'be metres; write {_line(path, 0.001)} if it is in millimetres, scale: 0.01 if it is '
            'in centimetres')
    return 0.001


def _tell_size(mesh: trimesh.Trimesh, scale: float, path: Path) -> None:
    """Log what the guess of a unit makes of a mesh, and the line that confirms or changes it."""
    size = ' x '.join(f'{each:.3g}' for each in scale * np.asarray(mesh.extents))
    unit = 'metres' if scale == 1 else 'millimetres'
    doubtful = scale != 1 or _diagonal(mesh) > _UNUSUAL
    _LOG.log(logging.WARNING if doubtful else logging.INFO,
             '%s: nothing says the unit of the mesh; taken as %s, it measures %s m. To confirm or '
             'change that, write %s', path, unit, size, _line(path, scale))


def _line(path: Path, scale: float) -> str:
    """What an object's YAML has to say about its unit."""
    if path.suffix.lower() in _DESCRIBED:
        return f'scale: {scale:g}'
    return f'{path.stem}.yaml with "mesh: {path.name}" and "scale: {scale:g}"'


def _diagonal(mesh: trimesh.Trimesh) -> float:
    with np.errstate(over='ignore'):
        return float(np.linalg.norm(np.ptp(np.asarray(mesh.vertices, float), axis=0)))


def read_mesh(path: Path) -> trimesh.Trimesh:
    """The mesh of a file: finite vertices, a surface, not too many faces; else ObjectModelError.
    """
    kind = path.suffix.lower().removeprefix('.')
    if not os.path.isfile(path):  # which takes any name
        raise ObjectModelError(f'no mesh file {path}')
    if kind not in _KINDS:
        raise ObjectModelError(f'{path} cannot be read as a mesh: {", ".join(_KINDS)} are read; '
                               'convert it, with Blender or MeshLab')
    try:
        data = read_bytes(path, _MOST_BYTES, 'simplify it, or write it as a binary STL or PLY')
    except FileError as error:
        raise ObjectModelError(str(error)) from None
    try:
        _check_size(mesh_size(data, kind))
        mesh = _whole(trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False))
        if not np.isfinite(mesh.triangles).all():
            raise ObjectModelError('has vertices that are not finite numbers')
        if not mesh.area > 0:
            raise ObjectModelError(f'holds {len(mesh.vertices)} vertices but no surface')
        # Corners that differ in colour or normal alone are one; those of no face are no part.
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
    except PmclError as error:
        raise ObjectModelError(f'{path} {error}') from None
    except MemoryError:
        raise
    except Exception as error:  # trimesh's readers raise whatever their parsers raise
        raise ObjectModelError(f'{path} cannot be read as a mesh: {error!r}') from error
    return mesh


def _check_size(size: MeshSize) -> None:
    """Raise ObjectModelError for too many faces, or what no such mesh needs."""
    for name, count, most in (('faces', size.faces, _MOST_FACES),
                              ('vertices', size.vertices, 3 * _MOST_FACES),
                              ('corners', size.corners, 4 * _MOST_FACES),
                              ('lines', size.lines, 10 * _MOST_FACES)):
        if count > most:
            raise ObjectModelError(f'has {count} {name}, at most {most} are read; simplify it')


def _whole(loaded: Any) -> trimesh.Trimesh:
    """The parts of a file as one mesh; ObjectModelError for none, or too many faces."""
    scene = loaded if isinstance(loaded, trimesh.Scene) else trimesh.Scene(loaded)
    # A part may be there many times, by reference.
    parts = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
    faces = sum(len(getattr(each, 'faces', ())) for each in parts)
    if not faces:
        raise ObjectModelError('holds no faces, and so no surface')
    _check_size(MeshSize(0, faces))
    return loaded if isinstance(loaded, trimesh.Trimesh) else loaded.to_mesh()


def _declared_axis(symmetries: list[_ContinuousSymmetry], name: str) -> NDArray[np.float64] | None:
    if not symmetries:
        return None
    axis, offset = np.array(symmetries[0].axis), np.array(symmetries[0].offset)
    length = np.linalg.norm(axis)
    if length < 1e-9 or np.linalg.norm(np.cross(axis / max(length, 1e-9), offset)) > 1e-6:
        raise ObjectModelError(
            f'object {name!r}: symmetry axis {axis.tolist()} through {offset.tolist()} must be a '
            'direction through the origin of the mesh; move that origin onto the axis')
    return axis / length


def _check_group(mesh: trimesh.Trimesh, group: NDArray[np.float64], name: str) -> None:
    """Warn if a declared group moves the surface: that may be meant, as with a small mark."""
    if len(group) == 1:
        return
    points, surface, noise = _surface_of(mesh)
    off = max(float(surface.query(points @ each[:3, :3].T + each[:3, 3])[0].max())
              for each in group) - noise
    extent = float(np.linalg.norm(mesh.extents))
    _LOG.info('object %r: %d discrete symmetries, the identity among them', name, len(group))
    if off > 0.02 * extent:
        _LOG.warning('object %r: its declared discrete symmetries move its surface by up to '
                     '%.1f mm; poses that far apart count as one', name, 1e3 * off)


def _check_scan(mesh: trimesh.Trimesh, name: str) -> None:
    """Warn of what scans bring along and a search suffers from: many faces, holes, a far origin.

    Raises ObjectModelError for an origin so far away that poses about it say nothing.
    """
    if len(mesh.faces) > _MANY_FACES:
        _LOG.warning('object %r: %d faces make a search take minutes, 20,000 are enough; simplify '
                     'the mesh', name, len(mesh.faces))
    faces = mesh.faces[(mesh.faces != np.roll(mesh.faces, 1, axis=1)).all(axis=1)]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, uses = np.unique(edges @ [len(mesh.vertices), 1], return_counts=True)
    if (uses == 1).any():
        _LOG.warning('object %r: its mesh is not closed, %.2g %% of the edges belong to one face '
                     'only; close holes of a scan, their rims count as outlines', name,
                     100 * (uses == 1).mean())
    far, diagonal = float(np.linalg.norm(mesh.bounds.mean(axis=0))), _diagonal(mesh)
    if far > _FARTHEST * diagonal:
        raise ObjectModelError(f'object {name!r}: its origin is {far:.3g} m from the middle of '
                               f'its mesh, which measures {diagonal:.3g} m; move it into the mesh')
    if far > diagonal:
        _LOG.warning('object %r: its origin is %.3g m from the middle of its mesh, which measures '
                     '%.3g m; region and pose are those of the origin: better move it into the '
                     'mesh', name, far, diagonal)


def _found_axis(mesh: trimesh.Trimesh, name: str) -> NDArray[np.float64] | None:
    """The axis through the origin about which turning the surface leaves it as it is.

    Within 2 % of its diagonal. Tried are z, x, y, and the principal axes of the surface, about
    which most of a rod has to be as round as a vessel. Warns of an axis that is elsewhere.
    """
    points, surface, noise = _surface_of(mesh)
    tolerance = noise + 0.01 * float(np.linalg.norm(mesh.extents))

    usual = np.quantile(surface.query(points)[0], _MOST_POINTS)

    def off(axis: NDArray[np.float64], through: NDArray[np.float64]
            ) -> Iterator[NDArray[np.float64]]:
        for angle in (0.5, 1.3, 2.1, 3.0):
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


def _surface_of(mesh: trimesh.Trimesh) -> tuple[NDArray[np.float64], cKDTree, float]:
    """Points (n, 3) of the surface, others to be the nearest of, and how near those are [m]."""
    points = trimesh.sample.sample_surface(mesh, 4000, seed=0)[0]
    surface = cKDTree(trimesh.sample.sample_surface(mesh, 20000, seed=1)[0])
    return points, surface, float(surface.query(points)[0].max())
