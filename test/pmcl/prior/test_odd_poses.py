"""Poses of cameras that are something else than they should be are told."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.pmcl.prior.odd_poses import check_poses, likely_mistake, sees, without_mistakes
from pmcl_ros.pmcl.prior.region import Box, Region, regions_before, with_region
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError

CAMERA = Pinhole(640, 480, 600.0, 600.0, 322.0, 238.0)
PLACE = (0.5, 0.2, 0.1)
BACKWARDS = np.diag([1.0, -1, -1, 1])
# A link, x forward and z up, in the optical frame.
FROM_LINK = pose_of(Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]]), [0, 0, 0])


def around(begin=0, down=130):
    """Four cameras of an arm that look at PLACE from 0.6 m, down from above, over 90 degrees."""
    return [pose_of(turn, np.array(PLACE) - 0.6 * turn.as_matrix()[:, 2]) for turn in (
        Rotation.from_euler('ZX', [angle, -down], degrees=True)
        for angle in np.linspace(begin, begin + 90, 4))]


def in_millimetres(pose):
    pose = pose.copy()
    pose[:3, 3] *= 1000
    return pose


def transposed(pose):
    pose = pose.copy()
    pose[:3, :3] = pose[:3, :3].T
    return pose


def taken_for(order):
    """A pose whose quaternion x, y, z, w was read in another order."""
    return lambda pose: pose_of(Rotation.from_quat(
        Rotation.from_matrix(pose[:3, :3]).as_quat()[order]), pose[:3, 3])


def in_box(settings):
    """Whether PLACE is in the region."""
    return Box(settings.roi_center, settings.roi_size).contains(np.array([PLACE])).all()


def of_camera(poses):
    return [(CAMERA, pose) for pose in poses]


def test_a_camera_sees_what_is_before_it():
    camera = around()[0]
    assert sees(CAMERA, camera, PLACE)
    assert not sees(CAMERA, camera @ BACKWARDS, PLACE)
    assert not sees(CAMERA, camera, tuple(np.add(PLACE, 0.5 * camera[:3, 0])))


@pytest.mark.parametrize(('pixel', 'seen'), [
    ((-0.4, -0.4), True), ((639.4, 479.4), True), ((-0.6, 5), False), ((5, -0.6), False),
    ((639.6, 5), False), ((5, 479.6), False)], ids=str)
def test_a_picture_reaches_half_a_pixel_beyond_the_middles_of_its_outer_ones(pixel, seen):
    camera, before = around()[0], 0.7 * CAMERA.rays(np.array(pixel, float))
    assert sees(CAMERA, camera, tuple(camera[:3, :3] @ before + camera[:3, 3])) == seen
    assert (Region(tuple(before), (0.1, 0.1, 0.1)).middle_out_of_view(CAMERA) == '') == seen


@pytest.mark.parametrize(('mistaken', 'told'), [
    (inverse, 'from that frame to the camera? By their inverses all 4 views see its middle'),
    (lambda pose: pose @ BACKWARDS, 'look along -z (OpenGL, Blender)?'),
    (in_millimetres, 'are the poses in millimetres? In metres all 4 views'),
    (lambda pose: pose @ FROM_LINK, 'not of the optical frame? With the latter all 4 views'),
    (transposed, 'are the rotations transposed? By their transposes all 4 views'),
    (taken_for([3, 0, 1, 2]), 'w, x, y, z taken for x, y, z, w? By the former all 4 views'),
    (taken_for([1, 2, 3, 0]), 'x, y, z, w taken for w, x, y, z? By the former all 4 views'),
    (lambda pose: pose @ pose_of(Rotation.from_euler('x', 90, degrees=True), [0, 0, 0]),
     'are poses and region of the same frame, in metres')],
    ids=['inverses', 'opengl', 'millimetres', 'link', 'transposed', 'w first', 'w last',
         'another'])
def test_what_the_poses_seem_to_be_is_asked(mistaken, told):
    given = of_camera(mistaken(pose) for pose in around())
    asked = likely_mistake(given, PLACE)
    assert told in asked
    assert '; or ' not in asked  # nothing else explains it
    for question, mended in without_mistakes(given):
        if question in asked:
            np.testing.assert_allclose([pose for _, pose in mended], around(), atol=1e-12)


def test_each_of_two_mistakes_that_explain_it_is_asked():
    asked = likely_mistake(of_camera(map(taken_for([3, 0, 1, 2]), around(90, down=180))), PLACE)
    assert asked == ('are the poses from that frame to the camera? By their inverses all 4 views '
                     'see its middle; or are quaternions w, x, y, z taken for x, y, z, w? By the '
                     'former all 4 views see its middle')


def test_no_mistake_is_asked_without_which_no_more_views_see_it():
    """One camera looks elsewhere. Others are in metres, and mended they stay the same."""
    right = around()
    given = of_camera([*right, right[0] @ BACKWARDS])
    assert likely_mistake(given, PLACE).startswith('are poses and region of the same frame')


def test_a_region_in_the_frame_of_a_camera_is_asked_for():
    before = np.linalg.inv(around()[0]) @ [*PLACE, 1]
    cameras, asked = of_camera(around()), "is the region in a camera's frame?"
    assert asked in likely_mistake(cameras, before[:3])
    # Not where one sees it, nor where one would not see it in its own frame.
    assert asked not in likely_mistake([*cameras, (CAMERA, np.eye(4))], before[:3])
    other = CAMERA.crop(400, 0, 200, 480)
    assert asked not in likely_mistake([*cameras, (other, around()[0])], before[:3])


def test_it_is_asked_where_no_view_sees_the_region():
    with pytest.raises(LocalizationError, match=r'none of the 4 views sees .* By their inverses'):
        regions_before(of_camera(map(inverse, around())), PmclSettings(roi_center=PLACE), 0.05,
                       'base')


NEAR, ON_TABLE = {'roi_depths': (0.4, 0.8)}, {'roi_table': (*PLACE, 0, 0, 1)}


@pytest.mark.parametrize(('given', 'mistaken', 'told'), [
    (NEAR | ON_TABLE, inverse, 'from that frame to the camera? By their inverses there is one'),
    *((given, lambda pose: pose @ BACKWARDS, 'third column of their poses there is one')
      for given in (NEAR, ON_TABLE)),
    *((given, in_millimetres, 'are the poses in millimetres? In metres there is one')
      for given in (NEAR, ON_TABLE))])
def test_it_is_asked_where_all_that_is_in_view_is_nothing(given, mistaken, told):
    right, settings = around(), PmclSettings(**given)
    assert in_box(with_region(settings, of_camera(right), 0.05))
    with pytest.raises(LocalizationError, match=re.escape(told)):
        with_region(settings, of_camera(map(mistaken, right)), 0.05)


@pytest.mark.parametrize(('mistaken', 'told'), [
    (inverse, 'By their inverses 4 of 5 views see its middle'),
    (lambda pose: pose @ BACKWARDS, 'third column of their poses 4 of 5 views see its middle'),
    (in_millimetres, 'In metres all 5 views see its middle')],
    ids=['inverses', 'opengl', 'millimetres'])
def test_one_view_that_sees_it_by_chance_does_not_make_poses_right(mistaken, told):
    right = around(180)
    given = of_camera([right[0], *map(mistaken, right)])
    assert [sees(*each, PLACE) for each in given] == [True, *[False] * 4]
    with pytest.raises(LocalizationError, match=f'^1 of 5 views see the region of .*{told}; mend'):
        check_poses(given, PLACE, 1)
    check_poses(given[:2], PLACE, 1)  # the second of a growing set may look elsewhere
    check_poses(given, PLACE, 3)  # others see a part of it


@pytest.mark.parametrize('turned', [0, 45], ids=['along a rail', 'turning away'])
def test_most_views_may_look_past_the_region(turned):
    given = of_camera(pose_of(Rotation.from_euler('y', turned * number, degrees=True),
                              np.array([number, 0, 0])) for number in range(5))
    place = (0.0, 0.0, 0.6)
    assert [sees(*each, place) for each in given] == [True, *[False] * 4]
    check_poses(given, place, 1)


def test_a_region_that_reaches_behind_the_cameras_is_told():
    wide = PmclSettings(roi_center=PLACE, roi_size=(1.6, 1.6, 1.6))
    with pytest.raises(LocalizationError, match=r'reaches to the cameras or behind .* smaller'):
        regions_before(of_camera([*around(), around()[0] @ BACKWARDS]), wide, 0.05, 'base')
