"""Poses in YAML files: 16 numbers, or position and orientation as ROS prints them."""

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.pose_entry import Matrix
from pmcl_ros.lightfield.readers.read import read_source
from pmcl_ros.lightfield.readers.sweep_folder import FrameEntry
from pmcl_ros.lightfield.sweep.view_plan import ViewPlan
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import Settings
from pmcl_ros.simulation.camera_plan import CameraPlan

# As `ros2 topic echo --once` prints a Pose, and a Transform of a TransformStamped.
ECHOED = """\
position:
  x: 0.51
  y: -0.02
  z: 6.0e-01
orientation:
  x: 0.5
  y: -0.5
  z: 0.5
  w: 0.5
"""
EXPECTED = pose_of(Rotation.from_quat([0.5, -0.5, 0.5, 0.5]), [0.51, -0.02, 0.6])
AS_TRANSFORM = ECHOED.replace('position', 'translation').replace('orientation', 'rotation')


class OfPose(Settings):
    """A file with a pose."""

    pose: Matrix


def read(value):
    return np.reshape(OfPose.make({'pose': value}, 'a.yaml').pose, (4, 4))


@pytest.mark.parametrize('text', [
    ECHOED, AS_TRANSFORM,
    '{orientation: [0.5, -0.5, 0.5, 0.5], position: [0.51, -0.02, 0.6]}',
    '{translation: [0.51, -0.02, 0.6], rotation: {w: 0.5, x: 0.5, y: -0.5, z: 0.5}}'])
def test_a_pose_is_read_as_ros_prints_it(text):
    np.testing.assert_allclose(read(yaml.safe_load(text)), EXPECTED, atol=1e-15)


units = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(
    lambda values: np.linalg.norm(values) > 0.1)


@given(units, st.lists(st.floats(-10, 10), min_size=3, max_size=3))
def test_all_forms_are_one_pose(quaternion, position):
    quaternion = (np.array(quaternion) / np.linalg.norm(quaternion)).tolist()
    pose = pose_of(Rotation.from_quat(quaternion), position)
    rounded = [round(each, 4) for each in quaternion]
    for value, within in (
            (pose.tolist(), 0), (pose.ravel().tolist(), 0),
            ({'position': position, 'orientation': quaternion}, 1e-12),
            ({'translation': dict(zip('xyz', position, strict=True)),
              'rotation': dict(zip('xyzw', quaternion, strict=True))}, 1e-12),
            ({'position': position, 'orientation': rounded}, 1e-3)):
        np.testing.assert_allclose(read(value), pose, rtol=0, atol=within)


@pytest.mark.parametrize(('value', 'reason'), [
    ({'position': [1, 2, 3], 'orientation': [0.5, 0.5, 0.5, 0.6]},
     r'pose: orientation: the quaternion \(0.5, 0.5, 0.5, 0.6\) has length 1.054, not 1: x, y, z, '
     'w is the order, w last; no rotation is 0, 0, 0, 1'),
    (yaml.safe_load(ECHOED.replace('0.5', '0.0')), r'\(0, -0, 0, 0\) has length 0, not 1'),
    ({'position': [1, 2, 3], 'orientation': [0.1, 0.2, 0.3]},
     r'orientation: number 4 is missing \(got \[0.1, 0.2, 0.3\]\)'),
    ({'position': {'x': 1, 'y': 2}, 'orientation': [0, 0, 0, 1]},
     'position: expected x, y, z, got x, y'),
    ({'position': [1, 'far', 3], 'orientation': [0, 0, 0, 1]},
     r"position.1: Input should be a valid number.*\(got 'far'\)"),
    ({'position': [1, 2, float('nan')], 'orientation': [0, 0, 0, 1]}, 'position.2: .*finite'),
    ({'position': [1, 2, 3], 'rotation': [0, 0, 0, 1]},
     'a pose is 16 numbers, or has the keys position and orientation or translation and rotation, '
     'and no others; got position, rotation'),
    ({'header': {}, 'pose': {}}, 'and no others; got header, pose'), ({}, 'got none'),
    ([1.0] * 15, 'a pose has 16 numbers, 4x4, not 15')])
def test_what_is_no_pose_is_refused_in_one_line(value, reason):
    with pytest.raises(SettingsError, match=f'^a.yaml: pose: .*{reason.removeprefix("pose: ")}'
                       ) as caught:
        read(value)
    assert '\n' not in str(caught.value)


def test_each_file_of_poses_takes_them(tmp_path):
    """views.yaml, sweep.yaml, plans of views and of simulated cameras."""
    echoed = yaml.safe_load(ECHOED)
    cv2.imwrite(str(tmp_path / 'a.png'), np.random.default_rng(0).integers(
        0, 255, (48, 64, 3), np.uint8))
    (tmp_path / 'views.yaml').write_text(yaml.safe_dump({
        'cameras': {'one': {'width': 64, 'height': 48, 'fx': 50.0, 'cx': 32.0, 'cy': 24.0}},
        'views': [{'file': 'a.png', 'camera': 'one', 'camera_to_reference': echoed}]}))
    view, = read_source(tmp_path).views
    plan = tmp_path / 'plan.yaml'
    plan.write_text(yaml.safe_dump({'poses': [echoed, yaml.safe_load(AS_TRANSFORM)]}))
    for pose in (view.camera_to_reference, FrameEntry(file='a.png', **echoed).pose,
                 *ViewPlan.load(plan).cameras, *CameraPlan.load(plan).fixed):
        np.testing.assert_allclose(pose, EXPECTED, atol=1e-15)
