"""A folder of pictures and poses is a light field for every command."""

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from scipy.spatial.transform import Rotation
from sweep_scene import PINHOLE, frame, raster, write_sweep

from pmcl_ros.cli import main
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import GAMMA, encoded
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.lightfield.readers.read import (
    has_posed_views,
    is_light_field,
    read_light_field,
    read_source,
)
from pmcl_ros.lightfield.sweep.assemble import assemble
from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.lightfield.sweep.settings import SweepSettings
from pmcl_ros.messages import bags
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

SETTINGS = SweepSettings(rows=1, columns=3, baseline=0.01, near=0.4, far=1.0)
LENS = Lens(PINHOLE, (-0.1, 0.02, 0.0, 0.001))


@pytest.fixture
def folder(tmp_path):
    frames = [frame(f'{number}', pose, LENS) for number, pose
              in enumerate(raster(1, 3, 0.01, 0.0005, 0.2))]
    write_sweep(tmp_path / 'sweep', frames, SETTINGS)
    return tmp_path / 'sweep', frames


def changed(path, **values):
    found = yaml.safe_load(path.read_text())
    found.update(values)
    path.write_text(yaml.safe_dump(found))


@pytest.mark.parametrize('angles', [(-1.2, 0, 1.2), (-0.5, 0.5), (-0.5, -0.25, 0, 0.25, 0.5)])
def test_frames_from_around_an_object_are_posed_views(tmp_path, angles, caplog):
    poses = []
    for angle in angles:  # rad, about a point 0.5 m before the middle one
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec([0, angle, 0]).as_matrix()
        pose[:3, 3] = [0, 0, 0.5] - pose[:3, :3] @ [0, 0, 0.5]
        poses.append(pose)
    frames = [frame(f'{number}', pose, LENS) for number, pose in enumerate(poses)]
    write_sweep(tmp_path, frames, SETTINGS.model_copy(update={'shrink': 2}))
    shutil.copy(tmp_path / 'sweep.yaml', tmp_path / 'monday.yml')
    for source in (tmp_path, tmp_path / 'sweep.yaml', tmp_path / 'monday.yml'):
        assert has_posed_views(source)
        caplog.clear()
        found = read_source(source)
        assert caplog.text.count('the sweep is no grid: read as posed views') == 1
        assert found.header.frame_id == 'sweep'
        for view, taken in zip(found.views, frames, strict=True):
            np.testing.assert_allclose(view.camera_to_reference, taken.pose, atol=1e-12)
            straight = LENS.undistorted(encoded(taken.image, GAMMA), PINHOLE)
            np.testing.assert_array_equal(view.picture, Reduction(1, 2).shrunk(straight))
            assert view.pinhole == Reduction(1, 2).pinhole(PINHOLE)
        with pytest.raises(LightFieldError, match='and here a light field is needed'):
            read_light_field(source)


def test_frames_in_a_grid_are_a_light_field(folder):
    for source in (folder[0], folder[0] / 'sweep.yaml'):
        assert not has_posed_views(source)
        assert isinstance(read_source(source), LightField)


def test_a_grid_that_is_declared_posed_is_read_as_posed_views(tmp_path, caplog):
    caplog.set_level('INFO')
    frames = [frame(f'{number}', pose, LENS) for number, pose
              in enumerate(raster(3, 3, 0.05, 0.0005, 0.2))]
    wide = SETTINGS.model_copy(update={'rows': 3, 'baseline': 0.05})
    write_sweep(tmp_path, frames, wide)
    assert isinstance(read_source(tmp_path), LightField)
    changed(tmp_path / 'sweep.yaml', posed=True)
    for source in (tmp_path, tmp_path / 'sweep.yaml'):
        assert has_posed_views(source)
        caplog.clear()
        found = read_source(source)
        told, = [each for each in caplog.records if 'read as posed views' in each.message]
        assert told.levelname == 'INFO'  # as it was asked for
        assert 'posed is true' in told.message
        assert found.header.frame_id == 'sweep'
        for view, taken in zip(found.views, frames, strict=True):
            np.testing.assert_allclose(view.camera_to_reference, taken.pose, atol=1e-12)
            np.testing.assert_array_equal(view.picture, LENS.undistorted(
                encoded(taken.image, GAMMA), PINHOLE))
        with pytest.raises(LightFieldError, match='and here a light field is needed'):
            read_light_field(source)


def test_it_is_read_as_it_was_taken(folder):
    path, frames = folder
    expected = assemble(frames, SETTINGS, '').light_field
    shutil.copy(path / 'sweep.yaml', path / 'monday.yaml')
    for source in (path, path / 'sweep.yaml', path / 'monday.yaml'):
        assert is_light_field(source)
        found = read_light_field(source)
        assert found.header.stamp_ns == source.stat().st_mtime_ns
        assert found.grid.pinhole == expected.grid.pinhole
        np.testing.assert_allclose(found.grid.positions, expected.grid.positions, atol=1e-9)
        np.testing.assert_array_equal(found.views, expected.views)
        assert found.gamma == pytest.approx(1 / 2.2)
    small = read_light_field(path, shrink=2)
    assert small.grid.pinhole.width == expected.grid.pinhole.width // 2
    inner = expected.views[0, 1][:2, :2].mean(axis=(0, 1))
    np.testing.assert_allclose(small.views[0, 1][0, 0], inner, rtol=1e-5)


def camera_of_ros(width=PINHOLE.width):
    """The camera as `camera_calibration` of ROS writes it."""
    matrix = {'rows': 3, 'cols': 3, 'data': PINHOLE.matrix.ravel().tolist()}
    distortion = {'rows': 1, 'cols': 4, 'data': list(LENS.distortion)}
    return {'image_width': width, 'image_height': PINHOLE.height, 'camera_name': 'wrist',
            'camera_matrix': matrix, 'distortion_model': 'plumb_bob',
            'distortion_coefficients': distortion}


@pytest.mark.parametrize('degrees', [0.2, 50])
def test_the_camera_may_be_a_file_of_ros(tmp_path, degrees):
    """Of a light field and of posed views."""
    taken = [frame(f'{number}', pose, LENS) for number, pose
             in enumerate(raster(1, 3, 0.01, 0.0005, degrees))]
    write_sweep(tmp_path, taken, SETTINGS)
    own = read_source(tmp_path)
    changed(tmp_path / 'sweep.yaml', camera=camera_of_ros())
    found = read_source(tmp_path)
    if isinstance(own, LightField):
        assert found.grid.pinhole == own.grid.pinhole
        np.testing.assert_array_equal(found.views, own.views)
        return
    for one, other in zip(found.views, own.views, strict=True):
        assert one.pinhole == other.pinhole
        np.testing.assert_array_equal(one.picture, other.picture)


def test_a_camera_of_twelve_bits(folder, tmp_path):
    frames = [replace(each, image=each.image >> 4) for each in folder[1]]
    write_sweep(tmp_path / 'few', frames, SETTINGS.model_copy(update={'bits': 12}))
    found = read_light_field(tmp_path / 'few').views
    np.testing.assert_allclose(found, read_light_field(folder[0]).views, atol=1e-3)


def test_more_pictures_than_memory_holds_are_refused_by_the_first(folder):
    path, _ = folder
    found = yaml.safe_load((path / 'sweep.yaml').read_text())
    first = found['frames'][0]
    cv2.imwrite(str(path / first['file']), np.zeros((3000, 4000, 3), np.uint8))
    found['frames'] = [first] + [{**first, 'file': f'{number}.jpg'} for number in range(149)]
    (path / 'sweep.yaml').write_text(yaml.safe_dump(found))
    with pytest.raises(LightFieldError, match=r'150 pictures of .* px need 5\.0 GiB, at most 4'):
        read_light_field(path)


def test_frames_that_are_left_out_are_named(folder, caplog):
    path, _ = folder
    found = yaml.safe_load((path / 'sweep.yaml').read_text())
    found['frames'][2]['position'][2] += 0.1
    (path / 'sweep.yaml').write_text(yaml.safe_dump(found))
    assert read_light_field(path).grid.weights.sum() == 2
    assert '2.png: ' in caplog.text
    assert 'off the plane' in caplog.text


def frames(*files, w=1):
    return [{'file': each, 'position': [0, 0, 0], 'orientation': [0, 0, 0, w]} for each in files]


@pytest.mark.parametrize(('change', 'reason'), [
    ({'frames': frames('no.png', '0.png')}, 'there is no .*no.png'),
    ({'frames': frames('0.png', '1.png', w=3)}, 'has length 3'),
    ({'frames': frames('0.png', '1.png', '0.png')}, '0.png is there more than once'),
    ({'camera': {'fx': 200.0, 'cx': 80.0}}, r'camera.cy: Field required'),
    ({'near': 2.0}, 'near 2.0 m must be smaller'),
    ({'camera': camera_of_ros(width=320)}, 'sweep.yaml: pictures have 160x120 px, the camera '
     '320x120: give the calibration of this size'),
    ({'camera': camera_of_ros() | {'fx': 5.0}}, 'camera: fx: leave it out, camera_matrix'),
])
def test_what_is_wrong_is_told(folder, change, reason):
    path, _ = folder
    changed(path / 'sweep.yaml', **change)
    with pytest.raises((LightFieldError, SettingsError), match=reason):
        read_light_field(path)


def test_each_kth_view_of_no_grid_is_refused(folder):
    with pytest.raises(LightFieldError, match='are no grid'):
        read_light_field(folder[0], every=2)


def test_it_becomes_a_bag_as_other_light_fields_do(folder, tmp_path):
    bag = tmp_path / 'bag'
    result = CliRunner().invoke(main, ['bag', 'record', str(folder[0]), str(bag)])
    assert result.exit_code == 0, result.output
    assert [each.name for each in bags.topics(bag)] == [
        '/center/camera_info', '/center/image', '/views/camera_info', '/views/pupil', '/views']
