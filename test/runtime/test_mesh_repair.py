"""Meshes as programs and scanners write them become the surfaces that were meant."""

import numpy as np
import pytest
import trimesh

from pmcl_ros.runtime.mesh_repair import boundary_share, is_apart, repair


def ball(radius, x=0.0, is_inverted=False):
    mesh = trimesh.creation.icosphere(2, radius).apply_translation([x, 0, 0])
    if is_inverted:
        mesh.invert()
    return mesh


def volumes(mesh):
    """Of its bodies, signed, ascending."""
    return sorted(each.volume for each in mesh.split(repair=False))


SMALL, LARGE = ball(0.01).volume, ball(0.05).volume


@pytest.mark.parametrize('every', [2, 3, 7])
def test_faces_of_a_body_are_turned_one_by_one(every):
    mesh = ball(0.05)
    mesh.faces[::every] = mesh.faces[::every, ::-1]
    assert not mesh.is_winding_consistent
    told = repair(mesh)
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(LARGE)
    np.testing.assert_allclose((mesh.face_normals * mesh.triangles_center).sum(axis=1), 0.05,
                               rtol=0.03)
    assert told == [f'turned {-(-320 // every)} of its 320 faces outwards']


@pytest.mark.parametrize(('bodies', 'meant', 'turned'), [
    ([ball(0.05), ball(0.01, 0.1)], [SMALL, LARGE], 0),
    ([ball(0.05), ball(0.01, 0.1, True)], [SMALL, LARGE], 320),
    ([ball(0.01, 0.1, True), ball(0.05, 0, True)], [SMALL, LARGE], 640),
    ([ball(0.05), ball(0.01, 0.02, True)], [-SMALL, LARGE], 0),
    ([ball(0.05, 0, True), ball(0.01, 0.02)], [-SMALL, LARGE], 640),
    ([ball(0.05), ball(0.01, 0.02), ball(0.01, 0.1, True)], [SMALL, SMALL, LARGE], 320),
    # In the corner of the other's box, but not in it.
    ([ball(0.05), ball(0.001, 0, True).apply_translation([0.04] * 3)],
     [ball(0.001).volume, LARGE], 320),
], ids=['right', 'a part inverted', 'all inverted', 'cavity', 'cavity, all inverted',
        'part in a part', 'box in a box'])
def test_bodies_look_outwards_and_cavities_inwards(bodies, meant, turned):
    mesh = trimesh.util.concatenate(bodies)
    told = repair(mesh)
    assert volumes(mesh) == pytest.approx(meant)
    assert told == ([f'turned {turned} of its {len(mesh.faces)} faces outwards'] if turned else [])


def test_one_of_very_many_bodies_decides_for_all():
    mesh = trimesh.util.concatenate([ball(0.05, 0, True), *(
        ball(0.001, 0.06 + 0.003 * k, True) for k in range(200))])
    repair(mesh)
    assert min(volumes(mesh)) > 0


def test_open_meshes_stay_as_they_are():
    mesh = ball(0.05, 0, True)
    mesh.update_faces(np.arange(320) > 5)
    faces = mesh.faces.copy()
    assert repair(mesh) == []
    np.testing.assert_array_equal(mesh.faces, faces)


def soup(mesh, noise, size=1.0):
    """Its triangles, each with corners of its own that are off by a share of the diagonal."""
    corners = mesh.triangles.reshape(-1, 3) * size
    off = noise * np.linalg.norm(np.ptp(corners, axis=0))
    corners = corners + np.random.default_rng(0).uniform(-off, off, corners.shape)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)


@pytest.mark.parametrize('size', [0.1, 1.0, 1e3])
def test_corners_that_differ_by_rounding_are_one(size):
    mesh = soup(ball(0.05), 1e-7, size)
    assert is_apart(mesh)
    told = repair(mesh)
    assert (len(mesh.vertices), len(mesh.faces)) == (162, 320)
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(LARGE * size ** 3, rel=1e-4)
    assert len(told) == 1
    assert told[0].startswith('made 162 of its ')


def test_corners_that_are_farther_apart_stay_apart():
    mesh = soup(ball(0.05), 1e-4)
    assert repair(mesh) == []
    assert (len(mesh.vertices), len(mesh.faces)) == (960, 320)
    assert boundary_share(mesh) == 1
    assert is_apart(mesh)


def test_a_hole_of_a_fine_mesh_leaves_its_corners_as_they_are():
    mesh = ball(0.05)
    faces = mesh.faces.copy()
    faces[0, 0] = 162
    near = mesh.vertices[mesh.faces[0, 0]] * (1 + 1e-6)
    mesh = trimesh.Trimesh(np.vstack([mesh.vertices, near]), faces, process=False)
    assert repair(mesh) == []
    assert len(mesh.vertices) == 163
    assert not is_apart(mesh)
    assert boundary_share(mesh) == pytest.approx(4 / 482)
