"""Cameras in the file that `camera_calibration` of ROS writes, against the message of the same."""

import cv2
import numpy as np
import pytest
import yaml

from pmcl_ros.lightfield.readers.posed_views import ViewsFile
from pmcl_ros.lightfield.readers.read import read_source
from pmcl_ros.messages.camera_info import lens_from
from pmcl_ros.messages.types import CameraInfo
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera

K = [50.5, 0.0, 31.0, 0.0, 51.0, 22.0, 0.0, 0.0, 1.0]
MODELS = [('plumb_bob', [-0.1, 0.02, 1e-05, 0.0, 0.0]), ('plumb_bob', [0.0] * 5), ('', [0.0] * 5),
          ('rational_polynomial', [0.1, 0.02, 0.001, 0.0, 0.0, 0.01, 0.0, 0.0]),
          ('equidistant', [0.02, -0.01, 0.0, 0.001])]


def written(model='plumb_bob', coefficients=MODELS[0][1]):
    """The text of the file, as `camera_calibration` lays it out."""
    numbers = ', '.join(map(str, coefficients))
    return f"""image_width: 64
image_height: 48
camera_name: wrist
camera_matrix:
  rows: 3
  cols: 3
  data: [50.5,  0. , 31. ,
          0. , 51. , 22. ,
          0. ,  0. ,  1. ]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {len(coefficients)}
  data: [{numbers}]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]
projection_matrix:
  rows: 3
  cols: 4
  data: [45., 0., 30., 0., 0., 46., 21., 0., 0., 0., 1., 0.]
"""


@pytest.mark.parametrize(('model', 'coefficients'), MODELS)
def test_a_file_tells_the_lens_that_the_message_tells(tmp_path, model, coefficients):
    (tmp_path / 'ost.yaml').write_text(written(model or "''", coefficients))
    camera = OrdinaryCamera.load(tmp_path / 'ost.yaml')
    message = CameraInfo(width=64, height=48, distortion_model=model, d=coefficients,
                         k=np.array(K))
    assert camera.lens == lens_from(message, False)
    camera.save(tmp_path / 'camera.yaml')  # by the keys of views.yaml
    assert 'camera_matrix' not in (tmp_path / 'camera.yaml').read_text()
    assert OrdinaryCamera.load(tmp_path / 'camera.yaml') == camera


def test_a_camera_of_views_yaml_may_be_such_a_file_with_more_keys(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    own = {'width': 64, 'height': 48, 'fx': 50.5, 'fy': 51.0, 'cx': 31.0, 'cy': 22.0,
           'distortion': MODELS[0][1]}
    found = []
    for name, camera in (('own', own), ('ros', yaml.safe_load(written()))):
        folder = tmp_path / name
        folder.mkdir()
        cv2.imwrite(str(folder / 'one.png'), picture)
        (folder / 'views.yaml').write_text(yaml.safe_dump({
            'cameras': {'wrist': camera | {'gamma': 1.8}},
            'views': [{'file': 'one.png', 'camera': 'wrist'}]}))
        found.append(read_source(folder))
    assert found[0].pinhole == found[1].pinhole
    np.testing.assert_array_equal(found[0].picture, found[1].picture)


@pytest.mark.parametrize(('old', 'new', 'reason'), [
    ('plumb_bob', 'fov', r"distortion model 'fov' is not known, only plumb_bob, rational_polynom"),
    ('plumb_bob', 'equidistant', r'has 5 coefficients; expected 0 or 4 .* are of plumb_bob'),
    ('cols: 5', 'cols: 4', r'distortion_coefficients: rows and cols are 1 and 4, which is 4 '
     'numbers, but data has 5'),
    ('rows: 3\n  cols: 3', 'rows: 1\n  cols: 9', r'camera_matrix: 1x9 numbers \[50.5, .*expected '
     '3x3: fx, 0, cx'),
    ('0. , 31. ,', '2. , 31. ,', r'camera_matrix: 3x3 numbers \[50.5, 2.0, .*expected 3x3: fx, 0'),
    ('0. , 51. ,', '3. , 51. ,', r'camera_matrix: 3x3 numbers .* 3.0, 51.0, .*expected 3x3: fx'),
    ('0. ,  1. ]', '0. ,  2. ]', r'camera_matrix: 3x3 numbers .* 2.0\], expected 3x3: fx, 0'),
    ('image_height: 48', 'image_height: 100001', 'image_height: .*less than or equal to 100000'),
    ('[50.5', '[0.0', r'focal lengths must be positive'),
    ('[50.5', '[.nan', r'camera_matrix.data.0: .*finite'),
    ('image_width: 64\n', '', 'image_width: Field required'),
    ('camera_matrix', 'cameramatrix', 'camera_matrix: Field required'),
    ('distortion_model', 'camera_model', 'camera_model: there is no such key'),
    ('camera_name: wrist', 'fx: 50.5', 'fx: leave it out, camera_matrix and its like tell it')])
def test_what_is_wrong_is_told_in_one_line(tmp_path, old, new, reason):
    path = tmp_path / 'ost.yaml'
    assert old in written()
    path.write_text(written().replace(old, new, 1))
    with pytest.raises(SettingsError, match=reason) as told:
        OrdinaryCamera.load(path)
    assert str(told.value).startswith(f'{path}: ')
    with pytest.raises(SettingsError, match=r'views.yaml: cameras.wrist.*' + reason) as told:
        ViewsFile.make({'cameras': {'wrist': yaml.safe_load(path.read_text())},
                        'views': [{'file': 'one.png', 'camera': 'wrist'}]}, 'views.yaml')
    assert len(str(told.value)) < 300


@pytest.mark.parametrize('text', ['5', 'camera_matrix', '[image_width]'])
def test_what_is_no_camera_is_refused(tmp_path, text):
    (tmp_path / 'ost.yaml').write_text(text)
    with pytest.raises(SettingsError, match=r'ost\.yaml'):
        OrdinaryCamera.load(tmp_path / 'ost.yaml')
    with pytest.raises(SettingsError, match=r'views\.yaml: cameras\.wrist'):
        ViewsFile.make({'cameras': {'wrist': yaml.safe_load(text)},
                        'views': [{'file': 'one.png', 'camera': 'wrist'}]}, 'views.yaml')
