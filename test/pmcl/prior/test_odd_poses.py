"""Poses of cameras that are something else than they should be are told."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.pmcl.prior.odd_poses import likely_mistake, sees
from pmcl_ros.pmcl.prior.region import regions_before
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError

CAMERA = Pinhole(640, 480, 600.0, 600.0, 322.0, 238.0)
PLACE = (0.5, 0.2, 0.1)


def around(count=4):
    """Cameras of an arm that look at PLACE from 0.6 m, 40 degrees down, over 90 degrees."""
    return [pose_of(turn, np.array(PLACE) - 0.6 * turn.as_matrix()[:, 2]) for turn in (
        Rotation.from_euler('ZX', [angle, -130], degrees=True)
        for angle in np.linspace(0, 90, count))]


def in_millimetres(pose):
    pose = pose.copy()
    pose[:3, 3] *= 1000
    return pose


def of_camera(poses):
    return [(CAMERA, pose) for pose in poses]


def test_a_camera_sees_what_is_before_it():
    camera = around()[0]
    assert sees(CAMERA, camera, PLACE)
    assert not sees(CAMERA, camera @ np.diag([1.0, -1, -1, 1]), PLACE)
    assert not sees(CAMERA, camera, tuple(np.add(PLACE, 0.5 * camera[:3, 0])))


@pytest.mark.parametrize(('mistaken', 'told'), [
    (inverse, 'from that frame to the camera? By their inverses all 4 views see its middle'),
    (lambda pose: pose @ np.diag([1.0, -1, -1, 1]), 'look along -z (OpenGL, Blender)?'),
    (in_millimetres, 'are the poses in millimetres? In metres all 4 views'),
    (lambda pose: pose @ pose_of(Rotation.from_euler('x', 90, degrees=True), [0, 0, 0]),
     'are poses and region of the same frame, in metres')],
    ids=['inverses', 'opengl', 'millimetres', 'another'])
def test_what_the_poses_seem_to_be_is_asked(mistaken, told):
    assert told in likely_mistake(of_camera(mistaken(pose) for pose in around()), PLACE)


def test_it_is_asked_where_no_view_sees_the_region():
    with pytest.raises(LocalizationError, match=r'none of the 4 views sees .* By their inverses'):
        regions_before(of_camera(map(inverse, around())), PmclSettings(roi_center=PLACE), 0.05,
                       'base')


def test_some_views_that_see_it_do_not_make_poses_right():
    # The reference frame is that of a camera, whose pose is its own inverse.
    first, *others = around()
    place = tuple(inverse(first)[:3, :3] @ PLACE + inverse(first)[:3, 3])
    poses = [np.eye(4), *(inverse(inverse(first) @ each) for each in others)]
    assert sees(CAMERA, poses[0], place)
    assert 'By their inverses all 4 views see its middle' in likely_mistake(
        of_camera(poses), place)


def test_a_region_that_reaches_behind_the_cameras_is_told():
    wide = PmclSettings(roi_center=PLACE, roi_size=(1.6, 1.6, 1.6))
    with pytest.raises(LocalizationError, match=r'reaches to the cameras or behind .* smaller'):
        regions_before(of_camera(around()), wide, 0.05, 'base')
