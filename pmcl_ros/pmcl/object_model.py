"""The object that is looked for: its mesh, and which motions leave it as it is."""

import logging
import os
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.geometry.mesh_symmetries import discrete_symmetries
from pmcl_ros.geometry.revolution_axis import ANGLES, revolution_axis
from pmcl_ros.geometry.se3 import rotations_about
from pmcl_ros.geometry.symmetry import Symmetry, symmetry_group
from pmcl_ros.pmcl.appearance import Appearance
from pmcl_ros.pmcl.mesh_checks import check_ball, check_declared, check_scan
from pmcl_ros.runtime.errors import FileError, ObjectModelError
from pmcl_ros.runtime.mesh_file import read_mesh
from pmcl_ros.runtime.resources import SCHEME, resolve
from pmcl_ros.runtime.settings import Settings, read_yaml
from pmcl_ros.runtime.text_file import read_json

_LOG = logging.getLogger(__name__)
_SMALLEST, _LARGEST = 0.005, 5.0  # m: diagonals of what a robot can be asked to find on a table
_UNUSUAL = 1.0  # m: from here on a mesh in "metres" is asked about
_CENTIMETRES = 50.0  # units: a mesh larger than metres can be, but smaller than this, may be in cm
_DESCRIBED = '.yaml', '.yml'  # files of objects, which name a mesh
_Matrix = Annotated[tuple[float, ...], Field(min_length=16, max_length=16)]


class _ContinuousSymmetry(Settings):
    axis: tuple[float, float, float]
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ObjectSettings(Settings):
    """An object's YAML file. Symmetries as in BOP's models_info.json."""

    mesh: str = Field(description='path of the mesh, relative to this file, or '
                      'package://pmcl_ros/...')
    scale: float = Field(1.0, gt=0, description='metres per unit of the mesh; where it is left '
                         'out, a mesh that is far too large for metres is taken as millimetres')
    symmetries_continuous: list[_ContinuousSymmetry] | None = Field(
        None, max_length=1, description='axis (in the mesh frame) about which any rotation leaves '
        'the object as it is; an empty list: none; left out: found from the mesh')
    symmetries_discrete: list[_Matrix] | None = Field(
        None, description='rigid motions in the mesh frame that leave the object as it is: 4x4 '
        'matrices, each 16 numbers row by row, their translations in units of the mesh; those '
        'that follow from them need not be given; an empty list: none; left out: found from the '
        'mesh')
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
    declared_up: (3,) direction in the mesh's frame that is said to point up when it stands.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    axis: NDArray[np.float64] | None
    closed: bool
    discrete: NDArray[np.float64] = field(default_factory=lambda: np.eye(4)[None])
    clear: bool = False
    declared_up: NDArray[np.float64] | None = None

    @cached_property
    def up(self) -> NDArray[np.float64]:
        """(3,) unit vector that points up when the object stands.

        As declared; else along the axis of symmetry, its largest part positive; else z.
        """
        if self.declared_up is not None:
            up = self.declared_up / np.abs(self.declared_up).max()  # whose squares may overflow
            return np.asarray(up / np.linalg.norm(up))
        if self.axis is not None:
            return np.asarray(self.axis * np.sign(self.axis[np.abs(self.axis).argmax()]))
        return np.array([0, 0, 1.0])

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
        mesh = read_mesh(_mesh_path(path, settings))
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
                f'{_LARGEST} m; in an object YAML, scale says the metres per unit of the mesh'
                + (': 0.001 for millimetres' if diagonal > _LARGEST else
                   f'; with scale: 1 it has {diagonal / scale:.4g} m'
                   if _SMALLEST <= diagonal / scale <= _LARGEST else ''))
        check_scan(mesh, name)
        check_ball(mesh, name)
        if settings.symmetries_continuous is not None:
            axis = _declared_axis(settings.symmetries_continuous, name)
        else:
            axis = revolution_axis(mesh, name)
            _LOG.info('object %r: %s', name, 'no rotational symmetry found' if axis is None else
                      f'rotationally symmetric about {axis.tolist()}, found from its mesh')
        reach = float(np.linalg.norm(vertices, axis=1).max())
        if settings.symmetries_discrete is None:
            discrete = _found_group(mesh, axis, name)
        else:
            discrete = symmetry_group(settings.symmetries_discrete, axis, scale, reach, name)
            if len(discrete) > 1:
                _LOG.info('object %r: %d discrete symmetries, the identity among them', name,
                          len(discrete))
                check_declared(mesh, discrete, 'discrete symmetries move', name)
        if axis is not None and settings.symmetries_continuous is not None:
            check_declared(mesh, rotations_about(axis, np.array(ANGLES)),
                           'axis of symmetry moves', name)
        look = settings.appearance
        made = cls(name, vertices, faces, axis, bool(mesh.is_volume), discrete,
                   look is not None and look.is_clear, None if look is None else look.declared_up)
        if settings.symmetries_discrete is None and look is not None and look.has_ends:
            _check_ends(made)
        return made


def mesh_file(path: Path | str) -> tuple[Path, float]:
    """The mesh file of an object, and metres per unit of it; raises as `ObjectModel.load`."""
    path = Path(path)
    settings = _described(path)
    mesh = _mesh_path(path, settings)
    return mesh, _scale_of(read_mesh(mesh), settings, path)


def _described(path: Path) -> ObjectSettings:
    """An object's YAML; a mesh file is as one that names this mesh and says no more."""
    if path.suffix.lower() in _DESCRIBED:
        return ObjectSettings.make(read_yaml(path), str(path))
    return ObjectSettings(mesh=path.name)


def _mesh_path(path: Path, settings: ObjectSettings) -> Path:
    if settings.mesh.startswith(SCHEME):
        return resolve(settings.mesh, 'mesh')
    if '://' in settings.mesh:
        raise ObjectModelError(f'{path}: mesh: {settings.mesh} is not looked up; write the path '
                               'of the mesh, relative to this file')
    mesh = path.parent / settings.mesh
    if path.suffix.lower() in _DESCRIBED and not os.path.isfile(mesh):
        raise ObjectModelError(f'{path}: mesh: no mesh file {mesh}; write its path, relative to '
                               'this file')
    return mesh


def _scale_of(mesh: trimesh.Trimesh, settings: ObjectSettings, path: Path) -> float:
    """Metres per unit of a mesh: as it is said, else guessed; ObjectModelError where in doubt."""
    diagonal = _diagonal(mesh)
    if 'scale' in settings.model_fields_set or diagonal <= _LARGEST:
        return settings.scale
    if diagonal <= _CENTIMETRES:
        raise ObjectModelError(
            f'{path}: nothing says the unit of the mesh, whose diagonal of {diagonal:.4g} cannot '
            f'be metres; write {_line(path, 0.001)} if it is in millimetres, scale: 0.01 if it is '
            'in centimetres, scale: 0.0254 if it is in inches')
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


def _found_group(mesh: trimesh.Trimesh, axis: NDArray[np.float64] | None, name: str
                 ) -> NDArray[np.float64]:
    """(k, 4, 4) discrete symmetries as of `Symmetry`, of the mesh: told, as they may be unwanted.
    """
    try:
        group = discrete_symmetries(mesh, axis, name)
    except ObjectModelError:
        _LOG.info('object %r: its mesh is nearly round, with too many discrete symmetries for a '
                  'list of them, so none is taken', name)
        return np.eye(4)[None]
    if len(group) > 1:
        _LOG.info('object %r: %d discrete symmetries found from its mesh, the identity among '
                  'them; write symmetries_discrete: [] if they are none', name, len(group))
    return group


def _check_ends(model: ObjectModel) -> None:
    """Warn where the outside tells no ends of an object that has two, its mouth say."""
    if ((model.discrete[:, :3, :3] @ model.up) @ model.up < -0.5).any():
        _LOG.warning('object %r: its outside looks the same upside down, so the pose may be '
                     'either way up; say how it is turned (--tilt, roi_tilt), or write '
                     'symmetries_discrete: []', model.name)
