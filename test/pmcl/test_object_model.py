import json
import logging
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from pmcl_scenes import bracket, cup

from pmcl_ros.pmcl.object_model import ObjectModel, mesh_file
from pmcl_ros.runtime.errors import ObjectModelError, SettingsError

MODELS = Path(__file__).parents[2] / 'models'


def mug():
    body = trimesh.creation.cylinder(0.04, 0.1, sections=48)
    handle = trimesh.creation.torus(0.025, 0.005)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return trimesh.util.concatenate([body, handle.apply_translation((0.04, 0, 0))])


def save(mesh, folder, name='thing.obj'):
    mesh.export(folder / name)
    return folder / name


def describe(folder, mesh, name='thing.obj', **fields):
    """An object's YAML beside its mesh."""
    save(mesh, folder, name)
    path = folder / 'thing.yaml'
    path.write_text(yaml.safe_dump({'mesh': name} | fields))
    return path


@pytest.mark.parametrize('name', ['wine_glass', 'shaker'])
def test_vessels_are_symmetric_about_z(name):
    model = ObjectModel.load(MODELS / f'{name}.obj')
    np.testing.assert_array_equal(model.axis, [0, 0, 1])
    assert model.name == name
    assert model.closed
    assert 0.1 < model.diameter < 0.25


@pytest.mark.parametrize(('mesh', 'axis'), [
    (trimesh.creation.cylinder(0.03, 0.1), [0, 0, 1]),
    (trimesh.creation.cylinder(0.03, 0.1, transform=trimesh.transformations.rotation_matrix(
        np.pi / 2, [0, 1, 0])), [1, 0, 0]),
    (cup().apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])),
     [0, 1, 0]),
    (trimesh.creation.box((0.05, 0.06, 0.1)), None),
    (trimesh.creation.box((0.05, 0.05, 0.1)), None),
    (trimesh.creation.cylinder(0.03, 0.1).apply_translation((0.02, 0, 0)), None),
    (mug(), None), (bracket(), None)],
    ids=['z', 'x', 'y', 'box', 'square box', 'off its axis', 'mug', 'bracket'])
def test_symmetry_is_found_from_the_mesh(tmp_path, mesh, axis):
    found = ObjectModel.load(save(mesh, tmp_path)).axis
    assert (found is None) == (axis is None)
    if axis is not None:
        np.testing.assert_array_equal(found, axis)


def test_what_was_loaded_is_the_mesh(tmp_path):
    mesh = mug()
    model = ObjectModel.load(save(mesh, tmp_path, 'mug.stl'))  # corners of each face apart
    assert model.name == 'mug'
    assert len(model.vertices) == len(mesh.vertices)
    assert model.vertices.dtype == np.float64
    assert model.faces.dtype == np.int64
    assert model.closed
    np.testing.assert_allclose(np.sort(model.vertices[model.faces].sum(axis=(1, 2))),
                               np.sort(mesh.triangles.sum(axis=(1, 2))), atol=1e-6)
    assert model.radius == pytest.approx(np.linalg.norm(mesh.vertices, axis=1).max())
    assert model.diameter == pytest.approx(np.linalg.norm(mesh.extents))


def test_vertices_of_no_face_are_no_part_of_the_object(tmp_path):
    box = trimesh.creation.box((0.05, 0.06, 0.1))
    stray = trimesh.Trimesh(np.vstack([box.vertices, [1, 1, 1]]), box.faces, process=False)
    model = ObjectModel.load(save(stray, tmp_path, 'thing.ply'))
    assert len(model.vertices) == 8
    assert model.radius < 0.07


def test_corners_with_texture_are_still_a_closed_mesh(tmp_path):
    # A tetrahedron whose every face has its own texture coordinates.
    lines = ['v 0 0 0', 'v .1 0 0', 'v 0 .1 0', 'v 0 0 .1',
             *(f'vt {u} {v}' for u in (0.1, 0.5, 0.9) for v in (0.1, 0.5, 0.9, 0.7)),
             'f 1/1 3/2 2/3', 'f 1/4 2/5 4/6', 'f 1/7 4/8 3/9', 'f 2/10 3/11 4/12']
    (tmp_path / 'textured.obj').write_text('\n'.join(lines))
    model = ObjectModel.load(tmp_path / 'textured.obj')
    assert len(model.vertices) == 4
    assert model.closed


def test_open_meshes_are_not_closed_and_inside_out_ones_are_turned(tmp_path):
    ball = trimesh.creation.icosphere(2, 0.05)
    opened = trimesh.Trimesh(ball.vertices, ball.faces[:-5])
    assert not ObjectModel.load(save(opened, tmp_path)).closed
    faces = ObjectModel.load(save(ball, tmp_path)).faces
    ball.invert()
    turned = ObjectModel.load(save(ball, tmp_path))
    assert turned.closed
    mesh = trimesh.Trimesh(turned.vertices, turned.faces, process=False)
    assert mesh.volume == pytest.approx(trimesh.creation.icosphere(2, 0.05).volume)
    assert len(turned.faces) == len(faces)


def test_a_description_scales_and_finds(tmp_path):
    millimetres = cup().apply_scale(1000)
    model = ObjectModel.load(describe(tmp_path, millimetres, scale=0.001))
    np.testing.assert_allclose(model.vertices.max(axis=0), cup().vertices.max(axis=0), atol=1e-8)
    np.testing.assert_array_equal(model.axis, [0, 0, 1])
    assert model.closed
    assert model.name == 'thing'


@pytest.mark.parametrize(('appearance', 'clear'), [
    (None, False), ({'material': 'glass'}, True), ({'material': 'tinted'}, True),
    ({'material': 'glass', 'roughness': 0.1}, False), ({'material': 'frosted'}, False),
    ({'material': 'opaque'}, False)])
def test_a_description_says_whether_the_object_is_clear(tmp_path, appearance, clear):
    said = {} if appearance is None else {'appearance': appearance}
    assert ObjectModel.load(describe(tmp_path, cup(), **said)).clear == clear


@pytest.mark.parametrize('said', ['mesh', 'description'])
@pytest.mark.parametrize(('unit', 'scale', 'words'), [
    (1.0, 1.0, ''), (0.06, 1.0, 'metres, it measures 1.07 x 1.07 x 1.67 m'),
    (0.001, 0.001, 'millimetres, it measures 0.064 x 0.064 x 0.1 m')])
def test_the_unit_that_nobody_says_is_guessed_and_told(tmp_path, caplog, said, unit, scale,
                                                      words):
    mesh = cup().apply_scale(1 / unit)
    path = save(mesh, tmp_path) if said == 'mesh' else describe(tmp_path, mesh)
    model = ObjectModel.load(path)
    np.testing.assert_allclose(np.ptp(model.vertices, axis=0), mesh.extents * scale, rtol=1e-6)
    assert mesh_file(path) == (tmp_path / 'thing.obj', scale)
    told = [each.getMessage() for each in caplog.records if each.levelname == 'WARNING']
    assert len(told) == bool(words)
    for each in told:
        assert words in each
        assert f'scale: {scale:g}' in each
    caplog.clear()
    described = describe(tmp_path, mesh, scale=scale)  # the line confirms it
    np.testing.assert_array_equal(ObjectModel.load(described).vertices, model.vertices)
    assert not [each for each in caplog.records if each.levelname == 'WARNING']


def test_a_unit_that_may_be_two_is_asked_for(tmp_path):
    centimetres = cup().apply_scale(100)
    with pytest.raises(ObjectModelError, match=r'thing\.yaml.*scale: 0\.001.*scale: 0\.01 if.*'
                       r'scale: 0\.0254 if it is in inches'):
        ObjectModel.load(save(centimetres, tmp_path))
    with pytest.raises(ObjectModelError, match=r'write scale: 0\.001.*scale: 0\.01 if'):
        ObjectModel.load(describe(tmp_path, centimetres))
    model = ObjectModel.load(describe(tmp_path, centimetres, scale=0.01))
    np.testing.assert_allclose(model.vertices, cup().vertices, atol=1e-8)


def test_a_description_declares_symmetry_or_none(tmp_path):
    path = describe(tmp_path, mug(), symmetries_continuous=[{'axis': [0, 0, 2.0]}])
    np.testing.assert_array_equal(ObjectModel.load(path).axis, [0, 0, 1])
    path = describe(tmp_path, mug(), symmetries_continuous=[
        {'axis': [1.0, 1.0, 0], 'offset': [3.0, 3.0, 0]}])
    np.testing.assert_allclose(ObjectModel.load(path).axis, [0.5 ** 0.5, 0.5 ** 0.5, 0])
    path = describe(tmp_path, cup(), symmetries_continuous=[])
    assert ObjectModel.load(path).axis is None


@pytest.mark.parametrize('symmetry', [
    {'axis': [0.0, 0, 0]}, {'axis': [0, 0, 1.0], 'offset': [0.01, 0, 0]}])
def test_an_axis_is_a_direction_through_the_origin(tmp_path, symmetry):
    path = describe(tmp_path, cup(), symmetries_continuous=[symmetry])
    with pytest.raises(ObjectModelError, match='must be a direction through the origin'):
        ObjectModel.load(path)


@pytest.mark.parametrize(('fields', 'message'), [
    ({'scale': 0}, 'scale: .*greater than 0'),
    ({'scale': float('nan')}, 'scale: .*finite'),
    ({'symmetry': 'z'}, 'symmetry: '),
    ({'symmetries_continuous': [{'axis': [0, 1]}]}, r'symmetries_continuous\.0\.axis'),
    ({'symmetries_continuous': [{'axis': [0, 0, 1]}] * 2}, 'at most 1'),
])
def test_impossible_descriptions_are_refused_by_name(tmp_path, fields, message):
    with pytest.raises(SettingsError, match=message):
        ObjectModel.load(describe(tmp_path, cup(), **fields))


def test_an_object_of_bop_is_in_millimetres_with_the_symmetries_of_its_list(tmp_path):
    carton = trimesh.creation.box((50, 60, 100))
    path = save(carton, tmp_path, 'obj_000012.ply')
    np.testing.assert_allclose(ObjectModel.load_bop(path).diameter, np.sqrt(.05**2 + .06**2 + .01))
    half = np.diag([-1.0, -1, 1, 1])
    (tmp_path / 'models_info.json').write_text(json.dumps({
        '12': {'diameter': 126.9, 'symmetries_discrete': [half.ravel().tolist()]}}))
    model = ObjectModel.load_bop(path)
    assert (model.name, model.axis, len(model.discrete)) == ('obj_000012', None, 2)
    described = describe(tmp_path, carton, scale=0.001,
                         symmetries_discrete=[half.ravel().tolist()], symmetries_continuous=[])
    np.testing.assert_array_equal(model.discrete, ObjectModel.load(described).discrete)
    # What the list does not call symmetric is not, whatever its mesh.
    round_one = save(trimesh.creation.cylinder(30, 100), tmp_path, 'obj_000013.ply')
    with pytest.raises(ObjectModelError, match='has no object 13'):
        ObjectModel.load_bop(round_one)
    (tmp_path / 'models_info.json').write_text('{"13": {"diameter": 120}}')
    assert ObjectModel.load_bop(round_one).axis is None


def test_missing_files_are_named(tmp_path):
    with pytest.raises(ObjectModelError, match=r'no mesh file .*nothing\.obj'):
        ObjectModel.load(tmp_path / 'nothing.obj')
    with pytest.raises(ObjectModelError, match='no mesh file'):
        ObjectModel.load(tmp_path)
    with pytest.raises(SettingsError, match=r'cannot read .*nothing\.yaml'):
        ObjectModel.load(tmp_path / 'nothing.yaml')
    (tmp_path / 'thing.yaml').write_text('mesh: nothing.ply')
    for of_file in ObjectModel.load, mesh_file:
        with pytest.raises(ObjectModelError, match=r'^\S*thing\.yaml: mesh: no mesh file '
                           r'\S*nothing\.ply; write its path, relative to this file$'):
            of_file(tmp_path / 'thing.yaml')


@pytest.mark.parametrize(('name', 'content', 'message'), [
    ('points.obj', b'v 0 0 0\nv .1 0 0\nv 0 .1 0\n', 'cannot be read as a mesh|no surface'),
    ('flat.obj', b'v 0 0 0\nv .1 0 0\nv .2 0 0\nf 1 2 3\n', 'no surface'),
    ('index.obj', b'v 0 0 0\nv .1 0 0\nv 0 .1 0\nf 1 2 9\n', 'cannot be read as a mesh'),
    ('nan.obj', b'v nan 0 0\nv .1 0 0\nv 0 .1 0\nf 1 2 3\n', 'not finite numbers'),
    ('infinite.obj', b'v inf 0 0\nv .1 0 0\nv 0 .1 0\nf 1 2 3\n', 'not finite numbers'),
    ('garbage.stl', bytes(range(256)) * 3, 'is cut short: its header tells 1397903696 faces'),
    ('garbage.ply', bytes(range(256)) * 3, 'cannot be read as a mesh'),
    ('garbage.glb', bytes(range(256)) * 3, 'cannot be read as a mesh'),
    ('picture.png', b'\x89PNG\r\n', 'cannot be read as a mesh'),
    ('name', b'', 'cannot be read as a mesh'),
    ('no.off', b'OFF\n0 0 0\n', 'holds no faces|cannot be read as a mesh'),
    ('scene.dae', b'<COLLADA/>', 'cannot be read as a mesh: stl, obj, ply, off, glb are read'),
    ('packed.zip', b'PK', 'cannot be read as a mesh: stl, obj, ply, off, glb are read'),
    ('large.stl', bytes(2 ** 26 + 1), 'has more than 64 MiB'),
    ('count.ply', b'ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n'
     b'property float x\nproperty float y\nproperty float z\nelement face 1\n'
     b'property list uchar int vertex_indices\nend_header\n', 'has 4000000000 vertices'),
    ('count.stl', bytes(80) + b'\xff\xff\xff\x7f' + bytes(50),
     'is cut short: its header tells 2147483647 faces'),
])
def test_files_that_hold_no_mesh_are_refused(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ObjectModelError, match=message) as caught:
        ObjectModel.load(path)
    assert name in str(caught.value)


BINARY = trimesh.creation.box((0.03, 0.05, 0.11)).export(file_type='stl')
POINTER = b'version https://git-lfs.github.com/spec/v1\noid sha256:abc\nsize 123\n'


@pytest.mark.parametrize(('name', 'content', 'message'), [
    ('cut.stl', BINARY[:-60], 'is cut short: its header tells 12 faces'),
    ('long.stl', BINARY + bytes(2), 'is longer than its header tells: 12 faces'),
    ('page.stl', b'<!DOCTYPE html><html><body>Not found</body></html>' * 10, 'is no STL'),
    ('short.stl', BINARY[:60], 'is no STL'),
    ('solid.stl', b'solid thing\nendsolid thing\n', 'is no STL'),
    *((f'pointer.{kind}', POINTER, 'only says where Git LFS keeps the mesh: git lfs pull fetches '
       'it') for kind in ('stl', 'obj', 'glb')),
    *((f'empty.{kind}', b'', 'is empty') for kind in ('stl', 'obj', 'ply', 'off', 'glb')),
    ('comma.obj', b'v 0,1 0 0\nv 0 0,1 0\nv 0 0 0,1\nf 1 2 3\n',
     'has commas in its decimals: write them with points'),
    ('comma.stl', b'solid\nfacet normal 0,0 0,0 1,0\nouter loop\n  vertex 0,1 0,0 0,0\n',
     'has commas in its decimals: write them with points'),
])
def test_files_that_are_damaged_are_told_plainly(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ObjectModelError) as caught:
        ObjectModel.load(tmp_path / name)
    assert str(caught.value) == f'{tmp_path / name} {message}'


def test_a_mesh_of_the_package_is_named_as_in_ros(tmp_path):
    path = tmp_path / 'glass.yaml'
    path.write_text('mesh: package://pmcl_ros/models/wine_glass.obj')
    np.testing.assert_array_equal(ObjectModel.load(path).vertices,
                                  ObjectModel.load(MODELS / 'wine_glass.obj').vertices)
    assert mesh_file(path)[0].samefile(MODELS / 'wine_glass.obj')
    path.write_text('mesh: package://pmcl_ros/models/none.obj')
    with pytest.raises(SettingsError, match=r'models/none\.obj is in none of'):
        ObjectModel.load(path)
    path.write_text('mesh: package://others/glass.obj')
    with pytest.raises(ObjectModelError, match=r'glass\.yaml.* relative to this file'):
        ObjectModel.load(path)


@pytest.mark.parametrize('kind', ['stl', 'obj', 'ply', 'off', 'glb'])
def test_kinds_of_mesh_files(tmp_path, kind):
    box = trimesh.creation.box((0.03, 0.05, 0.11))
    box.export(tmp_path / f'box.{kind}')
    found = ObjectModel.load(tmp_path / f'box.{kind}')
    assert (len(found.vertices), len(found.faces), found.closed) == (8, 12, True)
    assert found.diameter == pytest.approx(np.linalg.norm([0.03, 0.05, 0.11]), rel=1e-6)


def test_a_part_that_is_there_a_thousand_times(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.icosphere(4), geom_name='part')
    for number in range(200):
        scene.graph.update(f'copy {number}', 'world', geometry='part')
    scene.export(tmp_path / 'many.glb')
    assert (tmp_path / 'many.glb').stat().st_size < 200_000
    with pytest.raises(ObjectModelError, match=r'has 10\d{5} faces, at most 1000000'):
        ObjectModel.load(tmp_path / 'many.glb')


@pytest.mark.parametrize('scale', [1e-300, 1e-6, 0.03, 60, 1e9, 1e300])
def test_absurd_sizes_are_refused(tmp_path, scale):
    path = describe(tmp_path, cup(), scale=scale)
    with pytest.raises(ObjectModelError, match=r'diagonal of .* m, expected 0\.005 to 5\.0 m'
                       ) as caught:
        ObjectModel.load(path)
    assert ('0.001 for millimetres' in str(caught.value)) == (scale > 1)
    assert ('; with scale: 1 it has 0.' in str(caught.value)) == (scale in (1e-6, 0.03))


def test_a_mesh_too_fine_to_render_is_refused(tmp_path):
    sheet = np.stack(np.meshgrid(np.linspace(0, 0.1, 1001), np.linspace(0, 0.1, 502), [0.0]),
                     axis=-1).reshape(-1, 3)
    corner = (np.arange(501)[:, None] * 1001 + np.arange(1000)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, 1001], corner[:, None] + [1, 1002, 1001]])
    save(trimesh.Trimesh(sheet, faces, process=False), tmp_path, 'fine.stl')
    with pytest.raises(ObjectModelError, match='1002000 faces, at most 1000000 are read'):
        ObjectModel.load(tmp_path / 'fine.stl')


def test_any_axis_through_the_origin_is_found(tmp_path, caplog):
    """As of a scan, whose frame has no axis of the object's."""
    for seed in range(3):
        mesh = cup()
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(
            np.random.default_rng(seed).random(3)))
        expected = mesh.vertices[mesh.vertices @ mesh.vertices.mean(axis=0) > 0].mean(axis=0)
        axis = ObjectModel.load(save(mesh, tmp_path)).axis
        assert abs(axis @ expected) / np.linalg.norm(expected) > 0.9999
    assert not [each for each in caplog.records if each.levelname == 'WARNING']
    aside = 0.05 * np.cross(axis, [1, 0, 0]) / np.linalg.norm(np.cross(axis, [1, 0, 0]))
    mesh.apply_translation(aside)
    assert ObjectModel.load(save(mesh, tmp_path)).axis is None
    place = re.search(r'0\.05 m beside the origin, so that poses which look the same count as '
                      r'others .* to \[(.*), (.*), (.*)\] in metres', caplog.text).groups()
    np.testing.assert_allclose(np.array(place, float), aside, atol=2e-4)


@pytest.mark.parametrize(('change', 'told'), [
    (lambda mesh: mesh.apply_translation([0.3, 0, 0]), 'its origin is 0.3'),
    (lambda mesh: mesh.update_faces(np.arange(len(mesh.faces)) % 10 > 0), 'is not closed, 21 %'),
    (lambda mesh: mesh.update_faces(np.arange(len(mesh.faces)) > 0), 'is not closed, 1 %'),
    (lambda mesh: (mesh.unmerge_vertices(), mesh.vertices.__imul__(
        np.random.default_rng(0).uniform(1, 1.001, mesh.vertices.shape))),
     'is not closed, 100 % of the edges belong to one face only, as where faces share no corners'),
])
def test_what_a_scan_brings_along_is_told(tmp_path, caplog, change, told):
    mesh = cup()
    ObjectModel.load(save(mesh, tmp_path))
    assert not [each for each in caplog.records if each.levelname == 'WARNING']
    change(mesh)
    ObjectModel.load(save(mesh, tmp_path))
    assert told in caplog.text


def test_loose_bits_of_a_scan_are_told_once(tmp_path, caplog):
    bits = [trimesh.creation.icosphere(1, radius).apply_translation([0.12, y, 0.05])
            for y, radius in ((0, 0.002), (0.02, 0.003), (-0.02, 0.001))]
    ObjectModel.load(save(trimesh.util.concatenate([cup(), *bits]), tmp_path))
    warnings = [each.getMessage() for each in caplog.records if each.levelname == 'WARNING']
    assert warnings == ["object 'thing': loose parts count as parts of it: 3 of up to 0.006 m, "
                        'the largest at (0.12, 0.02, 0.05) m; delete those that are none']


@pytest.mark.parametrize('part', [
    trimesh.creation.cylinder(0.012, 0.01).apply_translation([0, 0, 0.2]),  # a cap
    trimesh.creation.icosphere(1, 0.001).apply_translation([0, 0, 0.05])], ids=['cap', 'bubble'])
def test_caps_and_what_is_inside_are_no_loose_bits(tmp_path, caplog, part):
    ObjectModel.load(save(trimesh.util.concatenate([cup(), part]), tmp_path))
    assert 'loose' not in caplog.text


def test_an_origin_far_away_is_refused(tmp_path):
    mesh = cup()
    mesh.apply_translation([3.0, 0, 0])
    with pytest.raises(ObjectModelError, match=r'its origin is 3 m from the middle of its mesh.* '
                       r'to \[3\.0, 0\.0, [0-9.-]*\] in metres say$') as caught:
        ObjectModel.load(save(mesh, tmp_path))
    place = json.loads(re.search(r'\[.*\]', str(caught.value))[0])
    np.testing.assert_allclose(place, mesh.bounds.mean(axis=0), atol=1e-5)


def prism(sides):
    return trimesh.creation.cylinder(0.03, 0.1, sections=sides)


def tumbler():
    return trimesh.creation.revolve([(0, 0), (0.025, 0), (0.032, 0.1), (0, 0.1)], sections=32)


TETRAHEDRON = trimesh.Trimesh(0.03 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]),
                              [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
OBLIQUE = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.01, 0.02, 0])


def twisted(turn):
    """A triangular prism whose upper end is turned; half turns are about no corner or face."""
    angles = 2 * np.pi * np.arange(3) / 3
    return trimesh.convex.convex_hull(np.concatenate([
        np.stack([0.03 * np.cos(each), 0.03 * np.sin(each), np.full(3, height)], axis=1)
        for each, height in ((angles, -0.05), (angles + turn, 0.05))]))


def pointed(corners):
    """With a point at both ends, which are its farthest corners."""
    return trimesh.convex.convex_hull(np.vstack([corners, [[0, 0, 0.08], [0, 0, -0.08]]]))


def open_box():
    box = trimesh.creation.box((0.05, 0.05, 0.05))
    return trimesh.Trimesh(box.vertices, box.faces[box.face_normals[:, 2] < 0.5])


def needle():
    """On a box; it has hardly a surface."""
    thin = trimesh.creation.cone(2e-5, 0.01, sections=3).apply_translation([0.012, 0.007, 0.05])
    return trimesh.util.concatenate([trimesh.creation.box((0.05, 0.05, 0.1)), thin])


@pytest.mark.parametrize(('mesh', 'count'), [
    (trimesh.creation.box((0.05, 0.06, 0.1)), 4), (trimesh.creation.box((0.05, 0.05, 0.1)), 8),
    (trimesh.creation.box((0.05, 0.05, 0.05)), 24), (TETRAHEDRON, 12),
    (trimesh.creation.icosahedron().apply_scale(0.04), 60), (prism(3), 6), (prism(6), 12),
    (prism(7), 14), (trimesh.creation.cone(0.03, 0.1, sections=7), 7),
    (trimesh.creation.cone(0.03, 0.1, sections=5), 5),
    (trimesh.creation.cylinder(0.03, 0.1, sections=48).apply_transform(np.diag([1, 0.7, 1, 1])),
     4), (bracket(), 1), (mug(), 2), (twisted(0.4), 6), (twisted(np.pi / 3), 6), (open_box(), 4),
    (needle(), 1), (pointed(prism(6).vertices), 12),
    (pointed(prism(3).vertices * [1, 1, 0]), 6), (pointed(prism(4).vertices * [1, 1, 0]), 8)],
    ids=['box', 'square box', 'cube', 'tetrahedron', 'icosahedron', 'triangle', 'hexagon',
         'heptagon', 'pyramid of 7 sides', 'pyramid', 'ellipse', 'bracket', 'mug', 'twisted',
         'antiprism', 'open box', 'needle', 'crystal',
         'bipyramid', 'square bipyramid'])
def test_motions_that_leave_the_mesh_as_it_is_are_found(tmp_path, caplog, mesh, count):
    """Wherever the mesh lies, they are a group and keep the set of its corners."""
    with caplog.at_level(logging.INFO):
        for place in (np.eye(4), OBLIQUE):
            moved = mesh.copy().apply_transform(place)
            model = ObjectModel.load(save(moved, tmp_path))
            assert (model.axis, len(model.discrete)) == (None, count)
            products = (model.discrete[:, None] @ model.discrete).reshape(-1, 4, 4)
            apart = np.abs(products[:, None] - model.discrete).max(axis=(2, 3)).min(axis=1)
            assert apart.max() < 1e-5
            np.testing.assert_array_equal(model.discrete[0], np.eye(4))
            if len(mesh.vertices) < 100:
                images = moved.vertices @ model.discrete[:, :3, :3].swapaxes(1, 2) + (
                    model.discrete[:, None, :3, 3])
                off = np.linalg.norm(images[:, :, None] - moved.vertices, axis=3).min(axis=2)
                assert off.max() < 1e-5
    told = [each.getMessage() for each in caplog.records if 'symmetries_discrete' in each.msg]
    assert len(told) == (2 if count > 1 else 0)
    assert all(f'{count} discrete symmetries found from its mesh' in each
               and 'write symmetries_discrete: []' in each for each in told)


@pytest.mark.parametrize('sections', [12, 25, 32])
@pytest.mark.parametrize('origin', [0, 0.05, -0.05])
@pytest.mark.parametrize('turn', [np.eye(4), OBLIQUE], ids=['upright', 'oblique'])
def test_a_cylinder_can_be_turned_round(tmp_path, sections, origin, turn):
    mesh = prism(sections).apply_translation([0, 0, origin])
    turn = turn.copy()
    turn[:3, 3] = 0
    model = ObjectModel.load(save(mesh.apply_transform(turn), tmp_path))
    assert abs(model.axis @ turn[:3, 2]) == pytest.approx(1, abs=1e-6)
    assert len(model.discrete) == 2
    other = model.discrete[1]
    np.testing.assert_allclose(other[:3, :3] @ model.axis, -model.axis, atol=1e-9)
    np.testing.assert_allclose(other[:3, 3], 2 * origin * turn[:3, 2], atol=1e-5)


@pytest.mark.parametrize(('sides', 'radius', 'length', 'part', 'axis', 'count'), [
    (6, 0.004, 0.18, 1, [0, 0, 1], 2), (8, 0.01, 0.16, 1, [0, 0, 1], 2),
    (9, 0.015, 0.2, 1, [0, 0, 1], 2), (64, 0.035, 0.25, 0.94, None, 4),
    (64, 0.01, 0.2, 0.93, [0, 0, 1], 2), (6, 0.01, 0.1, 1, None, 12)],
    ids=['pencil', 'rod', 'stick', 'oval can', 'oval rod', 'nut'])
def test_a_slender_object_is_as_symmetric_as_can_be_told(tmp_path, sides, radius, length, part,
                                                         axis, count):
    mesh = trimesh.creation.cylinder(radius, length, sections=sides)
    model = ObjectModel.load(save(mesh.apply_transform(np.diag([1, part, 1, 1])), tmp_path))
    assert (None if model.axis is None else model.axis.tolist()) == axis
    assert len(model.discrete) == count


@pytest.mark.parametrize(('look', 'told'), [
    ({'wall': 0.002, 'mouth': {'z': 0.05, 'open': True}}, True), ({'solid': True}, False),
    ({'solid': True, 'up': [0, 0, 1]}, True)])
def test_an_outside_that_does_not_tell_the_ends_apart_is_warned_of(tmp_path, caplog, look, told):
    path = describe(tmp_path, prism(32), appearance={'material': 'glass', **look})
    assert len(ObjectModel.load(path).discrete) == 2
    assert ('its outside looks the same upside down' in caplog.text) == told


@pytest.mark.parametrize('mesh', [cup(), tumbler()], ids=['cup', 'tumbler'])
def test_a_vessel_cannot_be_turned_round(tmp_path, mesh):
    assert len(ObjectModel.load(save(mesh, tmp_path)).discrete) == 1


def test_a_description_says_that_there_is_no_symmetry(tmp_path, caplog):
    for mesh in (trimesh.creation.box((0.05, 0.06, 0.1)), prism(32)):
        path = describe(tmp_path, mesh, symmetries_discrete=[])
        assert len(ObjectModel.load(path).discrete) == 1
    # What is round, and said not to be, gets no turns by small angles instead.
    for sections, count in ((12, 24), (16, 1), (48, 1), (49, 1), (64, 1)):
        caplog.clear()
        path = describe(tmp_path, prism(sections), symmetries_continuous=[])
        with caplog.at_level(logging.INFO):
            model = ObjectModel.load(path)
        assert (model.axis, len(model.discrete)) == (None, count)
        assert ('its mesh is nearly round, with too many' in caplog.text) == (count == 1)


@pytest.mark.parametrize(('name', 'count'), [
    ('models/shaker.obj', 1), ('models/wine_glass.obj', 1), ('config/objects/bottle.yaml', 1),
    ('config/objects/tumbler.yaml', 1), ('config/objects/block.yaml', 4),
    ('config/objects/block.stl', 4)])
def test_symmetries_of_the_shipped_objects(name, count):
    model = ObjectModel.load(MODELS.parent / name)
    assert len(model.discrete) == count
    assert (model.axis is None) == (count == 4)


def test_a_ball_is_told_to_be_one(tmp_path, caplog):
    ObjectModel.load(save(trimesh.creation.box((0.05, 0.05, 0.05)), tmp_path))
    assert 'it is a ball' not in caplog.text
    ball = trimesh.creation.icosphere(3, 0.03).apply_translation([0.01, 0, 0])
    ObjectModel.load(save(ball, tmp_path))
    assert 'it is a ball, whose orientation nothing tells' in caplog.text


def test_a_square_rod_is_not_round(tmp_path, caplog):
    for place in ([0, 0, 0], [0.006, 0.006, 0.1]):
        rod = trimesh.creation.box([0.012, 0.012, 0.2])
        rod.apply_translation(place)
        rod.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))
        assert ObjectModel.load(save(rod, tmp_path)).axis is None
    assert 'rotationally symmetric about' not in caplog.text


def test_faces_that_collapse_are_no_part_of_the_mesh(tmp_path, caplog):
    """As some programs write the poles of a sphere."""
    mesh = cup()
    one, other = mesh.faces[0, :2].tolist()
    stray = len(mesh.vertices)
    flat = np.vstack([mesh.faces, [[one, one, other], [other, one, other], [stray] * 3]])
    vertices = np.vstack([mesh.vertices, [1, 1, 1]])
    model = ObjectModel.load(save(trimesh.Trimesh(vertices, flat, process=False), tmp_path))
    assert model.closed
    np.testing.assert_array_equal(model.faces, mesh.faces)
    np.testing.assert_allclose(model.vertices, mesh.vertices, atol=1e-8)
    assert 'is not closed' not in caplog.text


def test_faces_whose_corners_lie_in_a_line_close_the_mesh(tmp_path):
    """As where one side of an edge was divided."""
    vertices = [[0, 0, 0], [.1, 0, 0], [0, .1, 0], [0, 0, .1], [.05, 0, 0]]
    faces = [[0, 2, 1], [0, 4, 3], [4, 1, 3], [0, 3, 2], [1, 2, 3], [0, 1, 4]]
    path = save(trimesh.Trimesh(vertices, faces, process=False), tmp_path)
    model = ObjectModel.load(path)
    assert (len(model.faces), model.closed) == (6, True)
