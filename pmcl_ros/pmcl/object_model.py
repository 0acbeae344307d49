"""The object that is looked for: its mesh in metres, and which rotations leave it as it is."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pmcl_ros.errors import ObjectModelError
from pmcl_ros.settings import Settings, read_yaml

_LOG = logging.getLogger(__name__)
_SMALLEST, _LARGEST = 0.005, 5.0  # m: diagonals of what a robot can be asked to find on a table
_MOST_FACES = 1_000_000


class _ContinuousSymmetry(Settings):
    axis: tuple[float, float, float]
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ObjectSettings(Settings):
    """An object's YAML file. Symmetries as in BOP's models_info.json."""

    mesh: str = Field(description='path of the mesh, relative to this file')
    scale: float = Field(1.0, gt=0, description='metres per unit of the mesh')
    symmetries_continuous: list[_ContinuousSymmetry] | None = Field(
        None, max_length=1, description='axis (in the mesh frame) about which any rotation leaves '
        'the object as it is; an empty list: none; left out: found from the mesh')


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """A mesh and its symmetry.

    vertices: (n, 3) float64 [m], each of them in a face. faces: (m, 3) int64.
    axis: (3,) unit vector through the mesh's origin about which the object is rotationally
        symmetric, or None.
    closed: the mesh is watertight with outward faces.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    axis: NDArray[np.float64] | None
    closed: bool

    @property
    def radius(self) -> float:
        """Of the smallest sphere about the origin that holds the mesh [m]."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    @property
    def diameter(self) -> float:
        """Diagonal of the mesh's bounding box [m]."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @classmethod
    def load(cls, path: Path | str) -> 'ObjectModel':
        """Read a mesh file (any that trimesh reads; metres) or an object's YAML.

        Raises ObjectModelError when there is no such mesh, no surface in it, or its size cannot be
        metres, SettingsError when the YAML cannot be read or says something impossible.
        """
        path = Path(path)
        if path.suffix.lower() in ('.yaml', '.yml'):
            settings = ObjectSettings.make(read_yaml(path), str(path))
            mesh = _read_mesh(path.parent / settings.mesh)
            mesh.vertices *= settings.scale
            return cls._from_mesh(mesh, path.stem, settings)
        return cls._from_mesh(_read_mesh(path), path.stem, None)

    @classmethod
    def _from_mesh(cls, mesh: trimesh.Trimesh, name: str, settings: ObjectSettings | None
                   ) -> 'ObjectModel':
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
        with np.errstate(over='ignore'):
            diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
        if not _SMALLEST <= diagonal <= _LARGEST:
            raise ObjectModelError(
                f'mesh {name!r} has a diagonal of {diagonal:.4g} m, expected {_SMALLEST} to '
                f'{_LARGEST} m; meshes are in metres: for millimetres write an object YAML with '
                'scale: 0.001')
        if settings is not None and settings.symmetries_continuous is not None:
            axis = _declared_axis(settings.symmetries_continuous, name)
        else:
            axis = _found_axis(mesh)
            _LOG.info('object %r: %s', name, 'no rotational symmetry found' if axis is None else
                      f'rotationally symmetric about {axis.tolist()}, found from its mesh')
        return cls(name, vertices, faces, axis, bool(mesh.is_volume))


def _read_mesh(path: Path) -> trimesh.Trimesh:
    """The mesh of a file: finite vertices, a surface, not too many faces."""
    if not path.is_file():
        raise ObjectModelError(f'no mesh file {path}')
    try:
        loaded: Any = trimesh.load_mesh(path, process=False)
        mesh = loaded if isinstance(loaded, trimesh.Trimesh) else loaded.to_mesh()
        corners = mesh.triangles
    except Exception as error:  # trimesh's readers raise whatever their parsers raise
        raise ObjectModelError(f'{path} cannot be read as a mesh: {error!r}') from error
    if len(mesh.faces) > _MOST_FACES:
        raise ObjectModelError(f'{path} has {len(mesh.faces)} faces, at most {_MOST_FACES} are '
                               'rendered; simplify it')
    if not np.isfinite(corners).all():
        raise ObjectModelError(f'{path} has vertices that are not finite numbers')
    if not mesh.area > 0:
        raise ObjectModelError(f'{path} holds {len(mesh.vertices)} vertices but no surface')
    # Corners that differ in colour or normal alone are one; those of no face are no part.
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return mesh


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


def _found_axis(mesh: trimesh.Trimesh) -> NDArray[np.float64] | None:
    """The mesh axis (z, x or y) about which turning the surface leaves it as it is.

    Within 2 % of its diagonal.
    """
    points = trimesh.sample.sample_surface(mesh, 4000, seed=0)[0]
    surface = cKDTree(trimesh.sample.sample_surface(mesh, 20000, seed=1)[0])
    tolerance = surface.query(points)[0].max() + 0.01 * float(np.linalg.norm(mesh.extents))
    for axis in (np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0])):
        turned = (Rotation.from_rotvec(angle * axis).apply(points)
                  for angle in (0.5, 1.3, 2.1, 3.0))
        if all(surface.query(each)[0].max() < tolerance for each in turned):
            return axis
    return None
