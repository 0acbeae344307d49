"""The sharp edges of a mesh, and what is said by edges that are seen there."""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.pmcl.object_model import ObjectModel

SHARP = np.deg2rad(30)  # between normals: round parts of more than twelve facets a turn have less


@dataclass(frozen=True)
class Creases:
    """Edges at which a mesh's surface turns by more than `SHARP`.

    ends: (m, 2, 3) [m]. normals: (m, 2, 3) of the faces on both sides. closed: these point out of
    the object; else they only agree with each other.
    profile: of the evidence across them, as a contour's; no side is the outside.
    """

    ends: NDArray[np.float64]
    normals: NDArray[np.float64]
    closed: bool
    profile: ContourProfile

    @classmethod
    def of(cls, model: ObjectModel, profile: ContourProfile | None = None) -> 'Creases | None':
        """Of a mesh as it was given: where it is simplified its facets turn otherwise.

        None where there are none, and for objects with an axis of symmetry: what creases say
        about those does not pay (docs/concepts/evidence.md). profile: by default the learned one.
        """
        if model.axis is not None:
            return None
        mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
        mesh.merge_vertices()
        sharp = mesh.face_adjacency_angles > SHARP
        if not sharp.any():
            return None
        return cls(np.asarray(mesh.vertices[mesh.face_adjacency_edges[sharp]], np.float64),
                   np.asarray(mesh.face_normals[mesh.face_adjacency[sharp]], np.float64),
                   model.closed, profile or ContourProfile.of_creases())
