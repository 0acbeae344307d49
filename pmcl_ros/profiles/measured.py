"""What was measured of a surface of revolution, and its files: a mesh and an object YAML."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.pmcl.appearance import Material
from pmcl_ros.pmcl.object_model import ObjectModel, ObjectSettings
from pmcl_ros.profiles.revolution import Revolution
from pmcl_ros.runtime.outputs import replacing

MeshKind = Literal['stl', 'obj', 'ply']
_SECTIONS = 96  # of the mesh, about the axis
_ROW = 0.0005  # m: between rows of the mesh, along the profile, at least


@dataclass(frozen=True)
class MeasuredProfile:
    """A surface of revolution as some views show it.

    surface: in the reference frame of the views. sigma: (m,) standard deviation of each point of
    `surface.wall` along its normal [m]. evidence: of the outline, mean over it [nat / px].
    least: evidence below which an outline is not one.
    """

    surface: Revolution
    sigma: NDArray[np.float64]
    evidence: float
    least: float

    @property
    def pose(self) -> NDArray[np.float64]:
        """(4, 4) of the object in the reference frame: z along the axis, origin at mid-height."""
        return self.surface.centred

    @property
    def rows(self) -> NDArray[np.float64]:
        """(k, 3) the wall from the bottom up: height, radius, standard deviation [m]."""
        wall = self.surface.wall - [0, (self.surface.low + self.surface.high) / 2]
        way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(wall, axis=0), axis=1))])
        kept = np.unique(np.searchsorted(way, np.arange(0, way[-1], _ROW)))
        kept = np.unique(np.append(kept, len(way) - 1))
        return np.column_stack([wall[kept, 1], wall[kept, 0], self.sigma[kept]])

    @property
    def mesh(self) -> trimesh.Trimesh:
        """Closed, in the frame of the object [m]."""
        heights, radii, _ = self.rows.T
        profile = np.stack([np.concatenate([[0], radii, [0]]),
                            np.concatenate([heights[:1], heights, heights[-1:]])], axis=1)
        mesh = trimesh.creation.revolve(profile, sections=_SECTIONS)
        mesh.merge_vertices()
        mesh.update_faces(mesh.nondegenerate_faces())
        mesh.remove_unreferenced_vertices()
        return mesh

    @property
    def model(self) -> ObjectModel:
        """As an object to look for."""
        mesh = self.mesh
        return ObjectModel('profile', np.asarray(mesh.vertices, float),
                           np.asarray(mesh.faces, np.int64), np.array([0, 0, 1.0]),
                           bool(mesh.is_volume))

    def describe(self) -> str:
        """Its size and how sure it is, in one line."""
        heights, radii, sigma = (1e3 * self.rows).T
        return (f'{np.ptp(heights):.1f} mm high, {2 * radii.max():.1f} mm wide; standard '
                f'deviation of the surface {np.median(sigma):.2f} mm (median), {sigma.max():.2f} '
                f'mm (largest); evidence {self.evidence:.2f} nat/px, at least {self.least:.2f} '
                'expected')

    def as_dict(self) -> dict[str, Any]:
        """For JSON: lengths in metres, the pose in the reference frame."""
        return {'object_to_reference': self.pose.tolist(), 'profile': self.rows.tolist(),
                'evidence': self.evidence, 'least_evidence': self.least}

    def write(self, path: Path, mesh: Path, comment: str, material: Material | None = None
              ) -> None:
        """Write an object YAML, and the mesh that it names. Raises as `Settings.save`."""
        with replacing(mesh) as part, part.open('wb') as file:
            self.mesh.export(file, file_type=mesh.suffix.removeprefix('.'))
        ObjectSettings.make({
            'mesh': mesh.name, 'scale': 1.0,
            'symmetries_continuous': [{'axis': (0.0, 0.0, 1.0)}],
            **({} if material is None else {'appearance': {'material': material}}),
            'profile': np.round(self.rows, 6).tolist()}).save(path, comment, given_only=True)
