"""transforms.json: the same views as from a views.yaml, and what is refused."""

import json
import logging
import math

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.metric import Metric
from pmcl_ros.lightfield.readers.read import (
    has_posed_views,
    has_scale,
    is_colmap,
    is_light_field,
    read_light_field,
    read_source,
)
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

WIDTH, HEIGHT = 48, 36
K = {'fx': 40.0, 'fy': 41.0, 'cx': 23.25, 'cy': 17.5}
CAMERA = {'fl_x': 40.0, 'fl_y': 41.0, 'cx': 23.75, 'cy': 18.0, 'w': WIDTH, 'h': HEIGHT}
LENS = {'k1': -0.2, 'k2': 0.05, 'k3': 0.01, 'p1': 0.001, 'p2': -0.002}
NAMES = ['images/a.png', 'images/b.png', 'images/c.png']
PICTURES = np.random.default_rng(0).integers(0, 255, (3, HEIGHT, WIDTH, 3), np.uint8)
MASK = np.full((HEIGHT, WIDTH), 255, np.uint8)
MASK[:, :7] = 0


def poses():
    made = np.tile(np.eye(4), (3, 1, 1))
    made[:, :3, :3] = Rotation.random(3, np.random.default_rng(1)).as_matrix()
    made[:, :3, 3] = [[0.1, 0.2, 0.3], [-0.2, 0.1, 0.5], [0.4, -0.3, 0.2]]
    return made


def of_views_yaml(folder, masks=('', '', ''), **camera):
    write_pictures(folder)
    (folder / 'views.yaml').write_text(yaml.safe_dump({
        'cameras': {'one': K | {'width': WIDTH, 'height': HEIGHT} | camera}, 'views': [
            {'file': name, 'camera': 'one', 'camera_to_reference': pose.ravel().tolist(),
             'mask': mask} for name, pose, mask in zip(NAMES, poses(), masks, strict=True)]}))
    return read_source(folder)


def write_pictures(folder):
    (folder / 'images').mkdir(parents=True, exist_ok=True)
    for name, picture in zip(NAMES, PICTURES, strict=True):
        cv2.imwrite(str(folder / name), picture)
    cv2.imwrite(str(folder / 'mask.png'), MASK)


def frames(scale=1.0):
    """A camera looks along -z there, and y is up."""
    opengl = poses()
    opengl[:, :3, 1:3] *= -1
    opengl[:, :3, 3] /= scale
    return [{'file_path': f'./{name}', 'transform_matrix': pose.tolist()}
            for name, pose in zip(NAMES, opengl, strict=True)]


def write(folder, shared, listed, name='transforms.json'):
    write_pictures(folder)
    (folder / name).write_text(json.dumps(shared | {'frames': listed}))
    return folder


def same(found, expected):
    assert isinstance(found, PosedViews)
    assert found.header.frame_id == 'transforms'
    for one, other in zip(found.views, expected.views, strict=True):
        np.testing.assert_array_equal(one.picture, other.picture)
        np.testing.assert_allclose(one.camera_to_reference, other.camera_to_reference, atol=1e-12)
        assert one.pinhole == other.pinhole
        assert one.name == other.name
        assert (one.mask is None) == (other.mask is None)
        if one.mask is not None:
            np.testing.assert_array_equal(one.mask, other.mask)


def test_they_are_the_same_views(tmp_path, caplog):
    expected = of_views_yaml(tmp_path / 'own')
    folder = write(tmp_path / 'a', CAMERA, frames())
    with caplog.at_level(logging.INFO):
        same(read_source(folder), expected)
    assert 'transforms.json: its poses count as metres' in caplog.text
    same(read_source(folder / 'transforms.json'), expected)
    same(read_source(write(tmp_path / 'b', CAMERA, frames(), 'transforms_train.json')
                     / 'transforms_train.json'), expected)
    same(read_source(write(tmp_path / 'c', CAMERA, [
        each | {'transform_matrix': each['transform_matrix'][:3]} for each in frames()])),
        expected)
    for path in (folder, folder / 'transforms.json'):
        assert is_light_field(path)
        assert has_posed_views(path)
        assert has_scale(path)
        assert not is_colmap(path)
        with pytest.raises(LightFieldError, match='pictures of ordinary cameras'):
            read_light_field(path)


def test_each_picture_may_have_its_own_camera(tmp_path):
    expected = of_views_yaml(tmp_path / 'own', distortion=[-0.2, 0.05, 0.001, -0.002, 0.01])
    own = [each | CAMERA | LENS | {'depth_file_path': 'd.png'} for each in frames()]
    same(read_source(write(tmp_path / 'a', {'camera_model': 'OPENCV', 'fl_x': 7.0}, own)),
         expected)
    own[1] |= {'fl_x': 50.0}
    views = read_source(write(tmp_path / 'b', {}, own)).views
    assert [each.pinhole.fx for each in views] == [40, 50, 40]


@pytest.mark.parametrize('said', [{'camera_model': 'OPENCV_FISHEYE'}, {'is_fisheye': True}])
def test_a_fisheye_is_that_of_opencv(tmp_path, said):
    numbers = [0.03, 0.005, 0.0006, 0.0001]
    expected = of_views_yaml(tmp_path / 'own', distortion=numbers, model='equidistant')
    shared = CAMERA | said | dict(zip(('k1', 'k2', 'k3', 'k4'), numbers, strict=True))
    same(read_source(write(tmp_path / 'a', shared, frames())), expected)


def test_an_angle_tells_the_focal_length_and_a_picture_its_size(tmp_path):
    """As Blender's exporters write it, names without an ending."""
    focal = 40.0
    expected = of_views_yaml(tmp_path / 'own', fx=focal, fy=focal, cx=23.5, cy=17.5)
    plain = [each | {'file_path': each['file_path'].removesuffix('.png')} for each in frames()]
    angles = {'camera_angle_x': 2 * math.atan(WIDTH / 2 / focal)}
    found = read_source(write(tmp_path / 'a', angles, plain))
    for one, other in zip(found.views, expected.views, strict=True):
        assert one.pinhole.fx == one.pinhole.fy == pytest.approx(focal)
        assert (one.pinhole.cx, one.pinhole.cy) == (23.5, 17.5)
        np.testing.assert_array_equal(one.picture, other.picture)
    angles['camera_angle_y'] = 2 * math.atan(HEIGHT / 2 / 41.0)
    found = read_source(write(tmp_path / 'b', angles, plain))
    assert found.views[0].pinhole.fy == pytest.approx(41.0)


def test_masks_are_read(tmp_path):
    expected = of_views_yaml(tmp_path / 'own', ('', 'mask.png', ''))
    listed = frames()
    listed[1]['mask_path'] = 'mask.png'
    listed[2]['mask_path'] = None
    same(read_source(write(tmp_path / 'a', CAMERA, listed)), expected)


@pytest.mark.parametrize(('shared', 'each'), [
    ({'aabb_scale': 16}, {}), ({}, {'colmap_im_id': 3}), ({}, {'sharpness': 20.5})])
def test_poses_of_colmap_need_a_scale(tmp_path, shared, each):
    expected = of_views_yaml(tmp_path / 'own')
    folder = write(tmp_path / 'a', CAMERA | shared, [one | each for one in frames(2.5)])
    with pytest.raises(LightFieldError, match=r'transforms.json, of COLMAP or instant-ngp, has no '
                       r'metric scale; give it, .*--scale, --distance'):
        read_source(folder)
    same(read_source(folder, metric=Metric(2.5)), expected)
    places = poses()[:, :3, 3]
    apart = float(np.linalg.norm(places[0] - places[2]))
    same(read_source(folder, metric=Metric(between=(NAMES[0], NAMES[2], apart))), expected)
    with pytest.raises(LightFieldError, match=r'has no image x.png; it has images/a.png, im'):
        read_source(folder, metric=Metric(between=('x.png', NAMES[2], apart)))


def test_a_scale_of_metric_poses_is_taken(tmp_path):
    expected = of_views_yaml(tmp_path / 'own')
    same(read_source(write(tmp_path / 'a', CAMERA, frames(1000.0)), metric=Metric(1000.0)),
         expected)


def test_each_kth_picture_is_read(tmp_path):
    expected = of_views_yaml(tmp_path / 'own')
    folder = write(tmp_path / 'a', CAMERA, frames())
    middle, = read_source(folder, every=3).views
    np.testing.assert_array_equal(middle.picture, expected.views[1].picture)
    two, = read_source(tmp_path / 'own', every=2).views
    np.testing.assert_array_equal(two.picture, expected.views[1].picture)


def test_other_lists_in_the_folder_come_first(tmp_path):
    of_views_yaml(tmp_path)
    write(tmp_path, CAMERA, frames())
    assert read_source(tmp_path).header.frame_id != 'transforms'
    assert read_source(tmp_path / 'transforms.json').header.frame_id == 'transforms'


def without(name):
    return {key: value for key, value in CAMERA.items() if key != name}


@pytest.mark.parametrize(('shared', 'change', 'reason'), [
    (CAMERA, {'file_path': ''}, 'frame 0: file_path: .*at least 1'),
    (CAMERA, {'file_path': './images/x.png'}, 'there is no .*x.png; every view needs its file'),
    (CAMERA, {'file_path': './images/b.png'}, 'images/b.png is there more than once'),
    (CAMERA, {'transform_matrix': [[1, 0, 0, 0]] * 2}, 'transform_matrix: .*at least 3'),
    (CAMERA, {'transform_matrix': [[1, 0, 0]] * 4}, 'transform_matrix.0: .*at least 4'),
    (CAMERA, {'transform_matrix': [[1, 0, 0, 0]] * 4}, 'no rotation'),
    (CAMERA, {'transform_matrix': [[1, 0, 0, float('nan')]] * 4}, 'finite'),
    (CAMERA, {'transform_matrix': None}, 'frame 0: transform_matrix: .*required'),
    (without('fl_x'), {}, 'frame 0: neither fl_x nor camera_angle_x tells the focal length'),
    (CAMERA | {'fl_x': -1}, {}, r'fl_x: .*greater than 0 \(got -1\)'),
    (CAMERA | {'camera_model': 'EQUIRECTANGULAR'}, {}, 'EQUIRECTANGULAR is not known, only OPENC'),
    (CAMERA | {'k4': 0.1}, {}, r'no k4 \(0.1\); undistort the pictures'),
    (CAMERA | {'w': 40}, {}, "it has 48x36 px, its camera '0' 40x36"),
    (CAMERA | {'w': 1e9}, {}, 'w: .*less than or equal to 100000'),
])
def test_what_is_wrong_is_told_in_one_line(tmp_path, shared, change, reason):
    first, *others = frames()
    folder = write(tmp_path, shared, [first | change, *others])
    with pytest.raises((LightFieldError, SettingsError), match=reason) as caught:
        read_source(folder)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('data', [{}, {'frames': 3}, {'frames': [1]}, {'frames': {'a': 1}}])
def test_a_json_of_something_else_is_told(tmp_path, data):
    (tmp_path / 'truth.json').write_text(json.dumps(data))
    with pytest.raises(LightFieldError, match=r'truth.json has no frames, a list of pictures'):
        read_source(tmp_path / 'truth.json')


def test_no_picture_at_all_is_told(tmp_path):
    with pytest.raises(SettingsError, match='there is no view; at least one is needed'):
        read_source(write(tmp_path, CAMERA, []))
