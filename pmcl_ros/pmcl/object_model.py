"""The object that is looked for: its mesh, and which motions leave it as it is."""

import logging
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydantic import Field
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pmcl_ros.geometry.mesh_symmetries import discrete_symmetries
from pmcl_ros.geometry.moved_surface import moved_by
from pmcl_ros.geometry.revolution_axis import ANGLES, revolution_axis
from pmcl_ros.geometry.se3 import rotations_about
from pmcl_ros.geometry.symmetry import Symmetry, symmetry_group
from pmcl_ros.pmcl.appearance import Appearance
from pmcl_ros.runtime.errors import FileError, ObjectModelError
from pmcl_ros.runtime.mesh_file import read_mesh
from pmcl_ros.runtime.mesh_repair import boundary_share, is_apart
from pmcl_ros.runtime.resources import SCHEME, resolve
from pmcl_ros.runtime.settings import Settings, read_yaml
from pmcl_ros.runtime.text_file import read_json

_LOG = logging.getLogger(__name__)
_SMALLEST, _LARGEST = 0.005, 5.0  # m: diagonals of what a robot can be asked to find on a table
_UNUSUAL = 1.0  # m: from here on a mesh in "metres" is asked about
_CENTIMETRES = 50.0  # units: a mesh larger than metres can be, but smaller than this, may be in cm
_MANY_FACES = 100_000
_BIT = 0.01  # of the area of the largest part: less is dust in a scan, a cap is more
_NO_BALL = 0.05  # share of its radius by which the surface of no ball differs less
_FARTHEST = 10  # diagonals: of the origin from the middle of the mesh
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
                + (': 0.001 for millimetres' if diagonal > _LARGEST else ''))
        _check_scan(mesh, name)
        _check_ball(mesh, name)
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
                _check_declared(mesh, discrete, 'discrete symmetries move', name)
        if axis is not None and settings.symmetries_continuous is not None:
            _check_declared(mesh, rotations_about(axis, np.array(ANGLES)),
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
    return path.parent / settings.mesh


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


def _check_declared(mesh: trimesh.Trimesh, motions: NDArray[np.float64], what: str, name: str
                    ) -> None:
    """Warn if declared motions move the surface: that may be meant, as with a small mark."""
    off = moved_by(mesh, motions)
    if off > 0.02 * float(np.linalg.norm(mesh.extents)):
        _LOG.warning('object %r: its declared %s its surface by up to %.1f mm; poses that far '
                     'apart count as one', name, what, 1e3 * off)


def _check_ball(mesh: trimesh.Trimesh, name: str) -> None:
    """Warn of what looks the same from all sides: no list of symmetries here can say that."""
    points = np.concatenate([mesh.vertices, mesh.triangles_center])
    radii = np.linalg.norm(points - mesh.bounds.mean(axis=0), axis=1)
    if np.ptp(radii) < _NO_BALL * radii.max():
        _LOG.warning('object %r: it is a ball, whose orientation nothing tells and no symmetry '
                     'here can declare: it may be lost where it is in plain view', name)


def _check_scan(mesh: trimesh.Trimesh, name: str) -> None:
    """Warn of what scans bring along and a search suffers from: many faces, holes, loose bits, a
    far origin.

    Raises ObjectModelError for an origin so far away that poses about it say nothing.
    """
    if len(mesh.faces) > _MANY_FACES:
        _LOG.warning('object %r: %d faces make a search take minutes, 20,000 are enough; simplify '
                     'the mesh', name, len(mesh.faces))
    share = boundary_share(mesh)
    if share:
        _LOG.warning('object %r: its mesh is not closed, %d %% of the edges belong to one face '
                     'only%s', name, max(1, round(100 * share)),
                     ', as where faces share no corners: merge close vertices' if is_apart(mesh)
                     else '; close holes of a scan, their rims count as outlines')
    if not is_apart(mesh):
        _tell_bits(mesh, name)
    far, diagonal = float(np.linalg.norm(mesh.bounds.mean(axis=0))), _diagonal(mesh)
    if far > _FARTHEST * diagonal:
        raise ObjectModelError(f'object {name!r}: its origin is {far:.3g} m from the middle of '
                               f'its mesh, which measures {diagonal:.3g} m; move it into the mesh')
    if far > diagonal:
        _LOG.warning('object %r: its origin is %.3g m from the middle of its mesh, which measures '
                     '%.3g m; region and pose are those of the origin: better move it into the '
                     'mesh', name, far, diagonal)


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
