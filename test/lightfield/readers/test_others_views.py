"""COLMAP models and BOP scenes: the same views as from a views.yaml, and what is refused."""

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from click import UsageError
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from pmcl_ros.cli import main
from pmcl_ros.cli.sources import GivenSource
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.readers import bop as bop_reader
from pmcl_ros.lightfield.readers.metric import Metric
from pmcl_ros.lightfield.readers.read import (
    has_posed_views,
    is_colmap,
    is_light_field,
    pictures_alone,
    read_source,
)
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

WIDTH, HEIGHT = 48, 36
K = {'fx': 40.0, 'fy': 41.0, 'cx': 23.25, 'cy': 17.5}
DISTORTION = [-0.2, 0.05, 0.001, -0.002]
RNG = np.random.default_rng(0)
PICTURES = RNG.integers(0, 255, (3, HEIGHT, WIDTH, 3), np.uint8)


def poses():
    made = np.tile(np.eye(4), (3, 1, 1))
    made[:, :3, :3] = Rotation.random(3, np.random.default_rng(1)).as_matrix()
    made[:, :3, 3] = [[0.1, 0.2, 0.3], [-0.2, 0.1, 0.5], [0.4, -0.3, 0.2]]
    return made


def write_pictures(folder, names):
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in zip(names, PICTURES, strict=True):
        cv2.imwrite(str(folder / name), picture)


def own(folder, distortion=()):
    """The same as views.yaml."""
    names = ['a.png', 'b.png', 'c.png']
    write_pictures(folder, names)
    camera = K | {'width': WIDTH, 'height': HEIGHT, 'distortion': list(distortion)}
    (folder / 'views.yaml').write_text(yaml.safe_dump({
        'cameras': {'one': camera}, 'views': [
            {'file': name, 'camera': 'one', 'camera_to_reference': pose.ravel().tolist()}
            for name, pose in zip(names, poses(), strict=True)]}))
    return read_source(folder)


def colmap(folder, scale=2.5, model='OPENCV', parameters=None, change=lambda text: text):
    """The same as a COLMAP model of which one unit is `scale` metres."""
    write_pictures(folder / 'images', ['a.png', 'b.png', 'c.png'])
    place = folder / 'sparse' / '0'
    place.mkdir(parents=True)
    if parameters is None:
        parameters = [K['fx'], K['fy'], K['cx'] + 0.5, K['cy'] + 0.5, *DISTORTION]
    (place / 'cameras.txt').write_text(
        f'# Camera list\n7 {model} {WIDTH} {HEIGHT} {" ".join(map(str, parameters))}\n')
    lines = ['# Image list']
    for number, (name, pose) in enumerate(zip('abc', poses(), strict=True)):
        back = np.linalg.inv(pose)
        x, y, z, w = Rotation.from_matrix(back[:3, :3]).as_quat()
        t = back[:3, 3] / scale
        lines += [f'{number} {w} {x} {y} {z} {t[0]} {t[1]} {t[2]} 7 {name}.png',
                  '' if number else '1.0 2.0 -1']
    (place / 'images.txt').write_text(change('\n'.join(lines) + '\n'))
    return folder


def bop(folder, with_poses=True, **changes):
    write_pictures(folder / 'rgb', [f'{number:06d}.png' for number in range(3)])
    cameras = {}
    for number, pose in enumerate(poses()):
        back = np.linalg.inv(pose)
        cameras[str(number)] = {'cam_K': [K['fx'], 0, K['cx'], 0, K['fy'], K['cy'], 0, 0, 1],
                                'depth_scale': 0.1}
        if with_poses:
            cameras[str(number)] |= {'cam_R_w2c': back[:3, :3].ravel().tolist(),
                                     'cam_t_w2c': (1000 * back[:3, 3]).tolist()}
    cameras['0'] |= changes
    (folder / 'scene_camera.json').write_text(json.dumps(cameras))
    return folder


def same(found, expected):
    assert isinstance(found, PosedViews)
    for one, other in zip(found.views, expected.views, strict=True):
        np.testing.assert_array_equal(one.picture, other.picture)
        np.testing.assert_allclose(one.camera_to_reference, other.camera_to_reference, atol=1e-9)
        assert one.pinhole == other.pinhole


def test_a_colmap_model_is_the_same_views(tmp_path):
    expected = own(tmp_path / 'own', DISTORTION)
    folder = colmap(tmp_path / 'colmap')
    same(read_source(folder, metric=Metric(2.5)), expected)
    same(read_source(folder / 'sparse' / '0', metric=Metric(2.5)), expected)
    places = poses()[:, :3, 3]
    apart = float(np.linalg.norm(places[0] - places[2]))
    same(read_source(folder, metric=Metric(between=('a.png', 'c.png', apart))), expected)
    assert is_light_field(folder)
    assert has_posed_views(folder)
    for name in ('cameras', 'images'):  # as Windows' Notepad saves them
        path = folder / 'sparse/0' / f'{name}.txt'
        path.write_text('\ufeff' + path.read_text())
    same(read_source(folder, metric=Metric(2.5)), expected)


MODEL_NUMBERS = {'SIMPLE_PINHOLE': 0, 'PINHOLE': 1, 'SIMPLE_RADIAL': 2, 'RADIAL': 3, 'OPENCV': 4,
                 'OPENCV_FISHEYE': 5, 'FULL_OPENCV': 6}


def make_binary(folder):
    """The text model of a folder in binary form, as COLMAP's documentation has it."""
    lines = [line.split() for line in (folder / 'cameras.txt').read_text().splitlines()
             if not line.startswith('#')]
    (folder / 'cameras.bin').write_bytes(struct.pack('<Q', len(lines)) + b''.join(
        struct.pack(f'<iiQQ{len(numbers)}d', int(name), MODEL_NUMBERS[model], int(width),
                    int(height), *map(float, numbers))
        for name, model, width, height, *numbers in lines))
    lines = [line.split() for line in (folder / 'images.txt').read_text().split('\n')[1:]]
    data = struct.pack('<Q', len(lines) // 2)
    for (number, *pose, camera, name), points in zip(lines[::2], lines[1::2], strict=False):
        data += struct.pack('<i7di', int(number), *map(float, pose), int(camera))
        data += name.encode() + struct.pack('<xQ', len(points) // 3)
        for x, y, point in zip(points[::3], points[1::3], points[2::3], strict=True):
            data += struct.pack('<ddq', float(x), float(y), int(point))
    (folder / 'images.bin').write_bytes(data)
    for name in ('cameras', 'images'):
        (folder / f'{name}.txt').unlink()


@pytest.mark.parametrize(('model', 'parameters', 'distortion'), [
    ('OPENCV', None, DISTORTION), ('SIMPLE_PINHOLE', (40.0, 23.75, 18.0), []),
    ('RADIAL', (40.0, 23.75, 18.0, -0.2, 0.05), [-0.2, 0.05, 0, 0])])
def test_a_binary_model_is_the_same_as_its_text(tmp_path, model, parameters, distortion):
    folder = colmap(tmp_path / 'colmap', model=model, parameters=parameters)
    expected = read_source(folder, metric=Metric(2.5))
    if model == 'OPENCV':
        same(expected, own(tmp_path / 'own', distortion))
    make_binary(folder / 'sparse' / '0')
    same(read_source(folder, metric=Metric(2.5)), expected)
    assert is_colmap(folder)


@pytest.mark.parametrize(('name', 'change', 'reason'), [
    ('images', lambda data: data[:-9], 'images.bin is damaged, .*after [12] images'),
    ('images', lambda data: data[:3], 'images.bin is damaged, .*after 0 images'),
    ('cameras', lambda data: data[:-1], 'cameras.bin is damaged, .*after 0 cameras'),
    ('cameras', lambda data: data[:12] + b'\7' + data[13:],
     'cameras.bin:1: the camera model 7 is not known, only'),
    ('images', lambda data: data.replace(b'a.png', b'\xff.png'), "after 0 images 'utf-8' codec"),
    ('images', lambda data: data[:78] + b'\xff' * 8 + data[86:], 'is damaged, .*after 1 images'),
])
def test_a_damaged_binary_model_is_told(tmp_path, name, change, reason):
    folder = colmap(tmp_path)
    make_binary(folder / 'sparse' / '0')
    file = folder / 'sparse/0' / f'{name}.bin'
    file.write_bytes(change(file.read_bytes()))
    with pytest.raises(LightFieldError, match=reason) as caught:
        read_source(folder, metric=Metric(1.0))
    assert '\n' not in str(caught.value)


def test_a_list_of_views_may_have_another_name(tmp_path):
    expected = own(tmp_path)
    mine = (tmp_path / 'views.yaml').rename(tmp_path / 'mine.yml')
    same(read_source(mine), expected)
    assert has_posed_views(mine)
    mine.write_text('{fx: 500, baseline: 0.01}\n')
    with pytest.raises(LightFieldError, match=r'mine\.yml: rows and columns are'):
        read_source(mine)


@pytest.mark.parametrize(('model', 'parameters', 'camera'), [
    ('SIMPLE_PINHOLE', [40, 24, 18], {'fx': 40.0, 'cx': 23.5, 'cy': 17.5}),
    ('PINHOLE', [40, 41, 24, 18], {'fx': 40.0, 'fy': 41.0, 'cx': 23.5, 'cy': 17.5}),
    ('SIMPLE_RADIAL', [40, 24, 18, -0.1],
     {'fx': 40.0, 'cx': 23.5, 'cy': 17.5, 'distortion': [-0.1, 0, 0, 0]}),
    ('RADIAL', [40, 24, 18, -0.1, 0.02],
     {'fx': 40.0, 'cx': 23.5, 'cy': 17.5, 'distortion': [-0.1, 0.02, 0, 0]}),
    ('FULL_OPENCV', [40, 41, 24, 18, 0.1, 0.2, 0.001, 0.002, 0.01, 0.02, 0.03, 0.01],
     {'fx': 40.0, 'fy': 41.0, 'cx': 23.5, 'cy': 17.5, 'model': 'rational_polynomial',
      'distortion': [0.1, 0.2, 0.001, 0.002, 0.01, 0.02, 0.03, 0.01]}),
    ('OPENCV_FISHEYE', [40, 41, 24, 18, 0.01, 0.02, 0.001, 0.002],
     {'fx': 40.0, 'fy': 41.0, 'cx': 23.5, 'cy': 17.5, 'model': 'equidistant',
      'distortion': [0.01, 0.02, 0.001, 0.002]}),
    ('OPENCV_FISHEYE', [20, 20, 24, 18, 0, 0, 0, 0],
     {'fx': 20.0, 'cx': 23.5, 'cy': 17.5, 'model': 'equidistant', 'distortion': [0, 0, 0, 0]})])
def test_colmap_s_cameras_are_those_of_opencv(tmp_path, model, parameters, camera):
    found = read_source(colmap(tmp_path, model=model, parameters=parameters), metric=Metric(1.0))
    own(tmp_path / 'own')
    path = tmp_path / 'own' / 'views.yaml'
    values = yaml.safe_load(path.read_text())
    values['cameras']['one'] = camera | {'width': WIDTH, 'height': HEIGHT}
    path.write_text(yaml.safe_dump(values))
    expected = read_source(path)
    for one, other in zip(found.views, expected.views, strict=True):
        np.testing.assert_array_equal(one.picture, other.picture)
        assert one.pinhole == other.pinhole


def test_a_model_without_a_metric_scale_is_refused(tmp_path):
    folder = colmap(tmp_path)
    with pytest.raises(LightFieldError, match='no metric scale; give it, or the distance'):
        read_source(folder)
    with pytest.raises(LightFieldError, match=r'no image x.png; it has a.png, b.png, c.png'):
        read_source(folder, metric=Metric(between=('a.png', 'x.png', 1.0)))
    with pytest.raises(LightFieldError, match='taken at one place'):
        read_source(folder, metric=Metric(between=('a.png', 'a.png', 1.0)))
    result = CliRunner().invoke(main, [
        'localize', str(folder), '--object', str(folder / 'sparse/0/cameras.txt'), '--roi',
        *['0', '0', '1', '1', '1', '1'], '--scale', '1', '--distance', 'a.png', 'b.png', '1'])
    assert '--scale and --distance say the same: give one' in result.output


def test_errors_of_the_poses_of_a_model_are_stated_by_options(tmp_path, caplog):
    folder = colmap(tmp_path)

    def stated(path=folder, scale=1.0, **given):
        views = GivenSource(path, scale=scale, **given).open().read().views
        return {(*each.sigma, each.common if each.group else 0.0) for each in views}
    assert stated() == {(0.0, 0.0, 0.0)}
    assert stated(sigma_mm=2.0) == {(0.002, 0.0, 0.0)}  # as in views.yaml without a group
    both = {'sigma_mm': 1.0, 'sigma_deg': 0.2, 'common': 0.5}
    given = (0.001, np.deg2rad(0.2), 0.5)
    assert stated(**both) == {given}
    assert not caplog.records
    own(tmp_path / 'own')
    path = tmp_path / 'own' / 'views.yaml'
    values = yaml.safe_load(path.read_text())
    for each in values['views']:
        each |= {'sigma_mm': 5.0, 'sigma_deg': 1.0, 'group': 'arm', 'common': 0.25}
    path.write_text(yaml.safe_dump(values))
    assert stated(path, None, sigma_mm=2.0) == {(0.002, np.deg2rad(1.0), 0.25)}
    assert stated(path, None, **both) == {given}
    assert [each.getMessage() for each in caplog.records] == [
        f'{path}: its camera poses count as {mm} mm and {deg} degrees off, in place of 5 mm and '
        '1 degrees' for mm, deg in ((2, 1), (1, 0.2))]
    with pytest.raises(UsageError, match='give these too'):
        stated(common=0.5)


@pytest.mark.parametrize(('change', 'reason'), [
    (lambda text: text.replace('7 a.png', 'a.png'), r'images.txt:2: expected IMAGE_ID'),
    (lambda text: text.replace('7 b.png', '8 b.png'), "of the camera '8', cameras has 7"),
    (lambda text: text.replace('c.png', 'a.png'), 'a.png is there more than once'),
    (lambda text: text.replace('c.png', 'd.png'), 'there is no .*d.png'),
    (lambda text: text[:0], 'there is no view; at least one is needed'),
    (lambda text: text.replace('\n\n', '\n'), r'images.txt:5: expected the points of the image'),
    (lambda text: text.replace('\n\n', '\n').replace('c.png', 'c d e.png'),
     r'images.txt:5: expected the points of the image'),
    (lambda text: text.replace('\n0 ', '\n0 9'), 'the quaternion .* has length'),
    (lambda text: text.replace('\n0 ', '\n0 nan '), 'length nan|expected IMAGE_ID|quaternion')])
def test_a_broken_model_is_refused_in_one_line(tmp_path, change, reason):
    folder = colmap(tmp_path, change=change)
    with pytest.raises(Exception, match=reason) as caught:
        read_source(folder, metric=Metric(1.0))
    assert '\n' not in str(caught.value)


def test_an_unknown_camera_of_colmap_is_refused(tmp_path):
    folder = colmap(tmp_path, model='FOV', parameters=[1, 2, 3, 4, 5])
    with pytest.raises(LightFieldError, match=r'cameras\.txt:2: the camera model FOV is not'):
        read_source(folder, metric=Metric(1.0))
    (tmp_path / 'sparse/0/cameras.txt').write_text('7 PINHOLE 48 36 40 41 24\n')
    with pytest.raises(LightFieldError, match='expected CAMERA_ID PINHOLE WIDTH HEIGHT FX FY CX'):
        read_source(folder, metric=Metric(1.0))


@pytest.fixture
def masked(tmp_path):
    """A model, and COLMAP's folder of masks, each black at another place."""
    model, folder = colmap(tmp_path / 'colmap'), tmp_path / 'masks'
    folder.mkdir()
    masks = np.full((3, HEIGHT, WIDTH), 255, np.uint8)
    for name, mask in zip('abc', masks, strict=True):
        mask[:, 12 * 'abc'.index(name):][:, :9] = 0
        cv2.imwrite(str(folder / f'{name}.png.png'), mask)
    return model, folder, masks


def test_each_picture_of_a_model_has_its_mask(tmp_path, masked, caplog, monkeypatch):
    caplog.set_level('INFO')
    model, folder, _ = masked
    path = tmp_path / 'own' / 'views.yaml'
    own(path.parent, DISTORTION)
    values = yaml.safe_load(path.read_text())
    for each in values['views']:
        each['mask'] = str(folder / f'{each["file"]}.png')
    path.write_text(yaml.safe_dump(values))
    expected, plain = read_source(path), read_source(model, metric=Metric(2.5))
    found = GivenSource(model, scale=2.5, masks=folder).open().read()
    same(found, plain)
    for one, other, each in zip(found.views, expected.views, plain.views, strict=True):
        np.testing.assert_array_equal(one.mask, other.mask)
        assert 0.1 < (~one.mask).mean() < 0.3
        assert each.mask is None
    assert caplog.messages == [f'each of 3 pictures has its mask in {folder}']
    # COLMAP takes the mask of a PNG by the picture's own name too.
    (folder / 'b.png.png').rename(folder / 'b.png')
    monkeypatch.chdir(tmp_path)
    again = GivenSource(model, scale=2.5, masks=Path('masks')).open().read()
    for one, other in zip(again.views, found.views, strict=True):
        np.testing.assert_array_equal(one.mask, other.mask)


def test_a_file_is_the_mask_of_all_pictures_of_a_model(masked, caplog):
    caplog.set_level('INFO')
    model, folder, _ = masked
    found = read_source(model, metric=Metric(1.0), masks=folder / 'a.png.png')
    first = read_source(model, metric=Metric(1.0), masks=folder).views[0].mask
    for each in found.views:
        np.testing.assert_array_equal(each.mask, first)
    assert caplog.messages[0] == f'{folder / "a.png.png"} is the mask of all pictures'


@pytest.mark.parametrize(('change', 'reason'), [
    (lambda path, _: path.unlink(), 'there is no .*b.png.png'),
    (lambda path, mask: cv2.imwrite(str(path), 0 * mask),
     'b.png.png: the mask is black everywhere'),
    (lambda path, mask: cv2.imwrite(str(path), mask[1:]),
     'b.png.png: the mask has 48x35 px, its camera 48x36: give a mask of the size'),
    (lambda path, _: path.write_bytes(b'none'), 'b.png.png')])
def test_a_mask_of_a_picture_that_is_none_is_refused_in_one_line(masked, change, reason):
    model, folder, masks = masked
    change(folder / 'b.png.png', masks[1])
    with pytest.raises(LightFieldError, match=reason) as caught:
        read_source(model, metric=Metric(1.0), masks=folder)
    assert '\n' not in str(caught.value)


def test_masks_are_of_colmap_models(masked, tmp_path):
    own(tmp_path / 'own')
    with pytest.raises(UsageError, match='is no COLMAP model: --masks'):
        GivenSource(tmp_path / 'own', masks=masked[1]).open()


def test_a_bop_scene_is_the_same_views(tmp_path):
    folder = bop(tmp_path / 'scene')
    same(read_source(folder), own(tmp_path / 'own'))
    assert has_posed_views(folder)
    assert not pictures_alone(folder)
    assert read_source(folder).header.frame_id == 'bop'


def test_cameras_of_another_resolution_are_told_in_one_line(tmp_path, caplog):
    path = bop(tmp_path / 'scene') / 'scene_camera.json'
    path.write_text(path.read_text().replace('23.25', '46.5').replace('17.5', '35'))
    read_source(path.parent)
    assert caplog.messages == [
        f"camera '0' and 2 more: the principal point (46.5, 35) is far from the middle of "
        f'{WIDTH}x{HEIGHT}: is the calibration of another resolution?']
    caplog.clear()
    read_source(colmap(tmp_path / 'model', parameters=[80, 82, 47, 35.5, *DISTORTION]),
                metric=Metric(2.5))
    assert caplog.messages == [
        f"camera '7': the principal point (46.5, 35) is far from the middle of {WIDTH}x{HEIGHT}: "
        'is the calibration of another resolution?']


def test_a_scene_s_pictures_may_be_called_in_capitals(tmp_path):
    folder = bop(tmp_path / 'scene')
    expected = read_source(folder)
    for each in (folder / 'rgb').iterdir():
        each.rename(each.with_suffix('.PNG'))
    same(read_source(folder), expected)
    (folder / 'rgb/000001.PNG').unlink()
    with pytest.raises(LightFieldError, match='no picture 000001 in rgb or gray, as png or jpg'):
        read_source(folder)


def test_a_picture_of_a_scene_is_localised_alone(tmp_path):
    folder = bop(tmp_path, with_poses=False)
    with pytest.raises(LightFieldError, match=r'has no poses .* give one, as .*000000.png'):
        read_source(folder)
    path = folder / 'rgb' / '000001.png'
    found = read_source(path)
    assert isinstance(found, PosedView)
    assert is_light_field(path)
    assert not has_posed_views(path)
    assert not has_posed_views(folder)
    assert pictures_alone(folder) == [folder / 'rgb' / f'{each:06d}.png' for each in range(3)]
    assert not pictures_alone(path)
    np.testing.assert_array_equal(found.camera_to_reference, np.eye(4))
    np.testing.assert_array_equal(found.displayed()[..., ::-1], PICTURES[1])


def test_pictures_without_poses_among_others_are_named(tmp_path):
    folder = bop(tmp_path)
    cameras = json.loads((folder / 'scene_camera.json').read_text())
    for number in '02':
        del cameras[number]['cam_R_w2c'], cameras[number]['cam_t_w2c']
    (folder / 'scene_camera.json').write_text(json.dumps(cameras))
    with pytest.raises(LightFieldError, match=r'2 of 3 pictures have no pose of their camera .*: '
                       r'0, 2; take them out, or localise one alone, as .*rgb/000000\.png'):
        read_source(folder)


def test_an_object_of_a_scene_is_found_by_its_number(tmp_path):
    scene = bop(tmp_path / 'set' / 'test' / '000001')
    mesh = tmp_path / 'set' / 'models' / 'obj_000007.ply'
    mesh.parent.mkdir()
    mesh.touch()
    assert bop_reader.model_of(scene, 7) == mesh
    assert bop_reader.model_of(scene / 'rgb' / '000002.png', 7) == mesh
    with pytest.raises(LightFieldError, match=r'has models/obj_000008.ply, the model of object 8'):
        bop_reader.model_of(scene, 8)
    for look in (read_source, lambda root: bop_reader.model_of(root, 7)):
        with pytest.raises(LightFieldError, match=rf'set is no scene, .* give a scene, {scene}, '
                           rf'or to evaluate all of {scene.parent}$'):
            look(tmp_path / 'set')


@pytest.mark.parametrize('unit', [1, 1000])
def test_a_scene_in_metres_is_told(tmp_path, caplog, unit):
    folder = bop(tmp_path / 'scene')
    path = folder / 'scene_camera.json'
    cameras = json.loads(path.read_text())
    for each in cameras.values():
        each['cam_t_w2c'] = (np.array(each['cam_t_w2c']) / unit).tolist()
    path.write_text(json.dumps(cameras))
    for _ in range(2):
        read_source(folder)
    assert len(caplog.messages) == (unit == 1000)
    assert all('3 cameras are all within 0.' in each and each.endswith(
        'mm: are cam_t_w2c in millimetres?') for each in caplog.messages)


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'cam_K': [1, 2]}, 'picture 0 needs cam_K, 9 numbers'),
    ({'cam_K': [40, 1, 23, 0, 41, 17, 0, 0, 1]}, 'picture 0 has skew 1'),
    ({'cam_R_w2c': [1, 0, 0, 1]}, 'cam_R_w2c and cam_t_w2c: expected 9 and 3 numbers, got 4'),
    ({'cam_R_w2c': [1.1, 0, 0, 0, 1, 0, 0, 0, 1]}, 'is no rotation'),
    ({'cam_t_w2c': 'far'}, 'expected 9 and 3 numbers, got 0')])
def test_a_broken_scene_is_refused_in_one_line(tmp_path, changes, reason):
    with pytest.raises(LightFieldError, match=reason) as caught:
        read_source(bop(tmp_path, **changes))
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('text', ['[1, 2]', '{"0": 3}', '{"a": {}}', '{', '[' * 100000])
def test_another_json_is_refused_in_one_line(tmp_path, text):
    folder = bop(tmp_path)
    (folder / 'scene_camera.json').write_text(text)
    with pytest.raises(LightFieldError, match=r'scene_camera\.json') as caught:
        read_source(folder)
    assert '\n' not in str(caught.value)


def test_a_light_field_is_one_whatever_else_lies_there(tmp_path):
    folder = colmap(tmp_path)
    np.savez(folder / 'views.npz', views=np.ones((1, 2, 4, 5, 3), np.float32), fx=9, fy=9, cx=2,
             cy=2, baseline=0.1)
    assert not has_posed_views(folder)
    assert read_source(folder).grid.shape == (1, 2)


def test_a_picture_of_a_scene_needs_no_other(tmp_path):
    folder = bop(tmp_path)
    (folder / 'rgb' / '000000.png').unlink()
    assert isinstance(read_source(folder / 'rgb' / '000002.png'), PosedView)
    with pytest.raises(LightFieldError, match='has no picture 000000'):
        read_source(folder)


def test_pictures_of_a_scene_come_by_their_numbers_each_with_a_whole_pose(tmp_path):
    path = bop(tmp_path) / 'scene_camera.json'
    (tmp_path / 'rgb' / '000001.png').rename(tmp_path / 'rgb' / '000010.png')
    cameras = json.loads(path.read_text())
    cameras['10'] = cameras.pop('1')
    path.write_text(json.dumps(cameras, sort_keys=True))  # 0, 10, 2
    assert [each.name for each in read_source(tmp_path).views] == [
        f'rgb/{number:06d}.png' for number in (0, 2, 10)]
    del cameras['10']['cam_t_w2c']
    path.write_text(json.dumps(cameras))
    with pytest.raises(LightFieldError, match=r'picture 10 needs .* with cam_t_w2c'):
        read_source(tmp_path)


def test_too_many_pictures_are_refused_before_they_are_read(tmp_path):
    own(tmp_path)
    path = tmp_path / 'views.yaml'
    values = yaml.safe_load(path.read_text())
    values['cameras']['one'] |= {'width': 20000, 'height': 15000}
    path.write_text(yaml.safe_dump(values))
    with pytest.raises(LightFieldError, match=r'its 3 pictures have up to 300\.0 million '
                       r'pixels, at most 33\.6 are read, and need 10300 MiB, at most 768: '
                       '.*--shrink 4.* fewer'):
        read_source(path)
    values['cameras']['one'] |= {'width': 5000, 'height': 5000}  # 12 % too many bytes
    path.write_text(yaml.safe_dump(values))
    with pytest.raises(LightFieldError, match=r'need 858 MiB, at most 768: .*--shrink 2'):
        read_source(path)


def test_poses_of_arm_and_camera_are_not_mixed(tmp_path):
    own(tmp_path)
    path = tmp_path / 'views.yaml'
    values = yaml.safe_load(path.read_text())
    values['views'][1]['mount_to_base'] = values['views'][1].pop('camera_to_reference')
    path.write_text(yaml.safe_dump(values))
    with pytest.raises(SettingsError, match='either all views have camera_to_reference, or none'):
        read_source(path)


def test_a_light_field_gives_its_centre_view_among_others(tmp_path):
    expected = own(tmp_path)
    rng = np.random.default_rng(2)
    light = rng.random((3, 3, 8, 10, 3), np.float32)
    np.savez(tmp_path / 'lytro.npz', views=light, fx=30, fy=31, cx=4, cy=3, baseline=0.001)
    path = tmp_path / 'views.yaml'
    values = yaml.safe_load(path.read_text())
    values['views'][1] = {'file': 'lytro.npz', 'sigma_mm': 2.0, 'stamp': 5.0,
                          'camera_to_reference': values['views'][1]['camera_to_reference']}
    path.write_text(yaml.safe_dump(values))
    found = read_source(path).views
    same(PosedViews(found[::2]), PosedViews(expected.views[::2]))
    view = found[1]
    assert (view.pinhole.fx, view.pinhole.width, view.header.stamp_ns) == (30, 10, 5_000_000_000)
    assert (view.header.frame_id, view.sigma[0]) == ('camera', 0.002)
    np.testing.assert_array_equal(view.camera_to_reference,
                                  expected.views[1].camera_to_reference)
    centre = light[1, 1] * (0.3 / light[1, 1].mean())
    np.testing.assert_allclose(view.linear(), centre.clip(0, 1), atol=1e-5)
    path.write_text(yaml.safe_dump(values | {'views': values['views'][1:2]}))
    assert read_source(path, shrink=2).views[0].picture.shape == (4, 5, 3)


@pytest.mark.parametrize(('entry', 'reason'), [
    ({'file': 'no.npz'}, r'cannot read .*no\.npz'),
    ({'file': 'no.npz', 'camera': 'one'}, r'no\.npz: a picture needs a camera, and a light field'),
    ({'file': 'a.png'}, r'a\.png: a picture needs a camera, and a light field \(\.npz\) has')])
def test_a_light_field_has_a_camera_of_its_own(tmp_path, entry, reason):
    (tmp_path / 'views.yaml').write_text(yaml.safe_dump({'views': [
        entry | {'camera_to_reference': np.eye(4).ravel().tolist()}]}))
    with pytest.raises((LightFieldError, SettingsError), match=reason) as caught:
        read_source(tmp_path)
    assert '\n' not in str(caught.value)
