"""What is known of a mesh before it is loaded is what is loaded then."""

import pytest
import trimesh

from pmcl_ros.runtime.mesh_size import mesh_size

BALL = trimesh.creation.icosphere(2)


def exported(kind, mesh=BALL, **options):
    data = mesh.export(file_type=kind, **options)
    return data.encode() if isinstance(data, str) else data


@pytest.mark.parametrize('kind', ['obj', 'ply', 'off', 'glb'])
def test_vertices_and_faces_are_those_of_the_mesh(kind):
    found = mesh_size(exported(kind), kind)
    assert (found.vertices, found.faces) == (len(BALL.vertices), len(BALL.faces))
    assert found.corners <= 3 * found.faces


@pytest.mark.parametrize('kind', ['stl', 'stl_ascii'])
def test_an_stl_has_three_vertices_a_face(kind):
    found = mesh_size(exported(kind), 'stl')
    assert found[:2] == (3 * len(BALL.faces), len(BALL.faces))


def test_a_ply_in_text():
    data = trimesh.exchange.ply.export_ply(BALL, encoding='ascii')
    found = mesh_size(data, 'ply')
    assert (found.vertices, found.faces) == (len(BALL.vertices), len(BALL.faces))
    assert found.lines == data.count(b'\n')


def test_normals_and_textures_count_as_vertices_do():
    data = b'v 0 0 0\n' * 3 + b'vn 0 0 1\n' * 7 + b'vt 0 1\n' * 9 + b'f 1/1/1 2/2/2 3/3/3\n'
    assert mesh_size(data, 'obj')[:2] == (9, 1)


@pytest.mark.parametrize(('kind', 'data'), [
    ('obj', b'v 0 0 0\n' * 3 + b'f ' + b'1 2 3 ' * 1000),
    ('off', b'# an OFF\nOFF # of\n3 1 0\n' + b'0 0 0\n' * 3 + b'3000 ' + b'0 1 2 ' * 1000),
    ('ply', b'ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nelement face 1\n'
     b'property list int int vertex_indices\nend_header\n0\n1\n2\n3000 ' + b'0 1 2 ' * 1000),
    ('ply', b'ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n'
     b'element face 1\nproperty list int int vertex_indices\nend_header\n' + bytes(12 + 4)
     + bytes(4 * 3000)),
], ids=['obj', 'off', 'ply in text', 'ply'])
def test_corners_of_polygons_are_counted(kind, data):
    found = mesh_size(data, kind)
    assert (found.vertices, found.faces) == (3, 1)
    assert 2900 < found.corners < 3050
