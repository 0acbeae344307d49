"""What meshes often lack where programs and scanners wrote them, mended without a guess."""

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

_APART = 0.5  # share of boundary edges: where there are more, faces share no corners
_NOISE = 1e-6  # of the diagonal: corners so close are one there, and differ by rounding
_MOST_BODIES = 30  # whose nesting is looked at, which takes a pass over the faces for each


def repair(mesh: trimesh.Trimesh) -> list[str]:
    """Mend a mesh in place; what a user should know of that, in words.

    Equal corners become one, nearly equal ones too where faces share none, and faces that thereby
    collapse are dropped. The faces of a closed mesh are turned to look outwards: those of each
    body, those of a body in another one into the cavity that it stands for.
    """
    # Corners that differ in colour or normal alone are one; those of no face are no part.
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    _drop_collapsed(mesh)
    done = []
    if is_apart(mesh):
        count = len(mesh.vertices)
        _merge_close(mesh)
        _drop_collapsed(mesh)
        if len(mesh.vertices) < count:
            done.append(f'made {len(mesh.vertices)} of its {count} corners, which differed by '
                        'rounding')
    turned = _turn_outwards(mesh) if mesh.is_watertight else 0
    if turned:
        done.append(f'turned {turned} of its {len(mesh.faces)} faces outwards')
    return done


def boundary_share(mesh: trimesh.Trimesh) -> float:
    """Share of the edges that belong to one face only: the rims of holes."""
    if mesh.is_watertight or mesh.is_empty:
        return 0.0
    _, uses = np.unique(mesh.edges_sorted @ [len(mesh.vertices), 1], return_counts=True)
    return float((uses == 1).mean())


def is_apart(mesh: trimesh.Trimesh) -> bool:
    """Whether most edges belong to one face only, as where faces share no corners."""
    return boundary_share(mesh) > _APART


def _merge_close(mesh: trimesh.Trimesh) -> None:
    """Make one of corners that are closer than rounding."""
    near = _NOISE * float(np.linalg.norm(mesh.extents))
    # One of each cell first: then a corner has few others so near, whatever the mesh.
    cells = ((mesh.vertices - mesh.bounds[0]) / near).astype(np.int64) @ [2 ** 42, 2 ** 21, 1]
    mesh.update_vertices(*np.unique(cells, return_index=True, return_inverse=True)[1:])
    pairs = cKDTree(mesh.vertices).query_pairs(near, output_type='ndarray')
    mesh.update_vertices(*np.unique(_components(pairs.T, len(mesh.vertices)), return_index=True,
                                    return_inverse=True)[1:])


def _components(links: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """(count,) the connected component of each node; links: (2, n) pairs of them."""
    graph = coo_array((np.ones(links.shape[1]), links), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _drop_collapsed(mesh: trimesh.Trimesh) -> None:
    """Faces with a repeated corner: they have no surface, and would count as rims of holes.

    Those of three corners in a line stay: their edges close the mesh.
    """
    kept = (mesh.faces != np.roll(mesh.faces, 1, axis=1)).all(axis=1)
    if not kept.all():
        mesh.update_faces(kept)
        mesh.remove_unreferenced_vertices()


def _turn_outwards(mesh: trimesh.Trimesh) -> int:
    """Turn faces of a closed mesh; their number."""
    body, turn = _bodies(mesh)
    middle = mesh.bounds.mean(axis=0)
    one, two, three = (mesh.triangles[:, k] - middle for k in range(3))
    volumes = np.bincount(  # six times that
        body, np.where(turn, -1.0, 1.0) * (one * np.cross(two, three)).sum(axis=1))
    if (volumes < 0).any():
        # A cavity is turned where the body around it is.
        turn ^= (volumes < 0)[_around(mesh.triangles, body, volumes)][body]
    if turn.any():
        mesh.faces = np.where(turn[:, None], mesh.faces[:, ::-1], mesh.faces)
    return int(turn.sum())


def _bodies(mesh: trimesh.Trimesh) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """The body (n,) of each face of a closed mesh, and which to turn for one winding in each.

    trimesh.repair.fix_winding does the latter face by face, and needs networkx.
    """
    count = len(mesh.faces)
    start, end = mesh.face_adjacency_edges.T[:, :, None]
    forward = [((mesh.faces[side] == start) & (np.roll(mesh.faces[side], -1, axis=1) == end))
               .any(axis=1) for side in mesh.face_adjacency.T]
    # Each face is there twice, as it is and turned: those that go together are connected.
    one, other = mesh.face_adjacency.T
    apart = count * (forward[0] == forward[1])
    links = np.hstack([[one, other + apart], [one + count, other + count - apart]])
    as_is, turned = _components(links, 2 * count).reshape(2, count)
    body = np.unique(np.minimum(as_is, turned), return_inverse=True)[1]
    turn = as_is > turned
    most = np.bincount(body, turn) > np.bincount(body) / 2  # the fewer are to turn
    return body, turn ^ most[body]


def _around(triangles: NDArray[np.float64], body: NDArray[np.intp], volumes: NDArray[Any]
            ) -> NDArray[np.intp]:
    """(k,) the largest body that each body lies in, or itself; of very many, the largest of all.
    """
    count = len(volumes)
    if count > _MOST_BODIES:
        return np.full(count, np.abs(volumes).argmax())
    bodies = [triangles[body == each] for each in range(count)]
    low, high = (np.array([end(each, axis=(0, 1)) for each in bodies]) for end in (np.min, np.max))
    around = []
    for inner, surface in enumerate(bodies):
        boxes = (low < low[inner]).all(axis=1) & (high > high[inner]).all(axis=1)
        holding = [each for each in np.flatnonzero(boxes).tolist()
                   if _holds(bodies[each], surface[0].mean(axis=0))]
        around.append(max([inner, *holding], key=np.abs(volumes).__getitem__))
    return np.array(around)


def _holds(triangles: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
    """Whether a point lies in a closed surface, which then fills the full solid angle.

    Halves of solid angles, by Van Oosterom and Strackee.
    """
    away = triangles - point
    a, b, c = np.moveaxis(away, 1, 0)
    far_a, far_b, far_c = np.linalg.norm(away, axis=2).T
    across = (a * np.cross(b, c)).sum(axis=1)
    along = (far_a * far_b * far_c + (a * b).sum(axis=1) * far_c + (b * c).sum(axis=1) * far_a
             + (c * a).sum(axis=1) * far_b)
    return bool(abs(np.arctan2(across, along).sum()) > np.pi)  # 2 pi or 0
