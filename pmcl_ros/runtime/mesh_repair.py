"""What meshes often lack where programs and scanners wrote them, mended without a guess."""

import numpy as np
import trimesh


def repair(mesh: trimesh.Trimesh) -> None:
    """Merge a mesh's equal corners, and drop the faces that thereby collapse."""
    # Corners that differ in colour or normal alone are one; those of no face are no part.
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    _drop_collapsed(mesh)


def _drop_collapsed(mesh: trimesh.Trimesh) -> None:
    """Faces with a repeated corner: they have no surface, and would count as rims of holes.

    Those of three corners in a line stay: their edges close the mesh.
    """
    kept = (mesh.faces != np.roll(mesh.faces, 1, axis=1)).all(axis=1)
    if not kept.all():
        mesh.update_faces(kept)
        mesh.remove_unreferenced_vertices()
