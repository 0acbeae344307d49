"""Which frames become posed views, and why others do not."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from textured_planes import PINHOLE as PLANES
from textured_planes import around, views_of_planes

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.sweep.frame import LeftOut, Lens, SweepFrame
from pmcl_ros.lightfield.sweep.settings import ViewSettings
from pmcl_ros.lightfield.sweep.view_collection import ViewCollection
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

PINHOLE = Pinhole(64, 48, 60.0, 60.0, 31.0, 24.0)
SHARP = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
BLURRED = (SHARP // 8 + 100).astype(np.uint8)


def frame(name, x=0.0, turn=0.0, image=SHARP, lens=None, at=7, **motion):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler('y', turn, degrees=True).as_matrix()
    pose[:3, 3] = x, 0, 0
    return SweepFrame(name, at, image, lens or Lens(PINHOLE), pose, **motion)


def collection(**changes):
    return ViewCollection(ViewSettings(near=0.3, apart=0.03, most_views=3, **changes), 'base')


def test_a_view_of_each_place_where_the_camera_rests():
    made = collection(sigma_position=0.002, common=0.25)
    assert made.add(frame('first'))
    assert not made.due
    assert not made.add(frame('moving', 0.1, speed=1.0))
    assert not made.add(frame('beside', 0.02))
    assert made.add(frame('turned', 0.02, 10))  # 0.3 m times 10 degrees, and 20 mm
    assert made.due
    assert not made.complete
    assert made.add(frame('third', 0.2))
    assert made.complete
    assert not made.add(frame('one more', 0.3))
    found = made.assemble()
    assert [each.name for each in made.frames] == ['first', 'turned', 'third']
    assert found.source.header.frame_id == 'base'
    for view, of in zip(found.source.views, made.frames, strict=True):
        np.testing.assert_array_equal(view.camera_to_reference, of.pose)
        np.testing.assert_allclose(view.picture, SHARP / 255, atol=1e-6)
        assert (view.sigma[0], view.common, view.group) == (0.002, 0.25, 'hand-eye')
    text = found.describe()
    assert text.startswith('3 posed views in base; left out: moving: moved by 2.0 px')
    assert 'one more: 3 views are there already (most_views)' in text
    assert '1 of places with a better one' in text


def test_views_of_what_drifts_are_uncertain_by_their_age():
    made = collection(drift=0.002, sigma_position=0.003, sigma_rotation=0.004, common=0.5)
    for number, seconds in enumerate((0, 6, 8)):
        made.add(frame(f'{number}', 0.1 * number, at=10 ** 9 * seconds))
    views = made.assemble().source.views
    assert [each.drift for each in views] == pytest.approx([0.016, 0.004, 0])
    # The errors of the arm and of the hand-eye transform are as large as before.
    assert {(each.sigma, each.common) for each in views} == {((0.003, 0.004), 0.5)}


def test_of_what_drifts_the_newest_views_stay():
    made = collection(drift=0.002)
    for number in range(5):
        assert made.add(frame(f'{number}', 0.1 * number, at=number))
        assert not made.complete
    assert not made.add(frame('beside', 0.41, at=5))
    assert [each.name for each in made.frames] == ['2', '3', '4']
    np.testing.assert_allclose([each.camera_to_reference[0, 3] for each
                                in made.assemble().source.views], [0.2, 0.3, 0.4])
    assert [str(each) for each in made.left_out] == [
        '0: it is the oldest of an object that drifts',
        '1: it is the oldest of an object that drifts', 'beside: 4 is there, 10.0 mm beside it']
    # Where the camera was before, it sees where the object is now.
    assert made.add(frame('again', 0.31, at=6))
    assert not made.add(frame('blurred', 0.21, image=BLURRED, at=7))
    assert [each.name for each in made.frames] == ['2', 'again', '4']


def test_where_stamps_begin_anew_the_views_do_too():
    made = collection(drift=0.002)
    for number in range(3):
        assert made.add(frame(f'{number}', 0.1 * number, at=(100 + number) * 10 ** 9))
    for number in range(2):
        assert made.add(frame(f'again {number}', 0.1 * number, at=number * 10 ** 9))
    assert [each.name for each in made.frames] == ['again 0', 'again 1']
    assert made.assemble().source.views[-1].sigma[0] == pytest.approx(0.001)


def planned(*places, **changes):
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, 0, 3] = places
    return ViewCollection(ViewSettings(**changes), 'base_link', poses)


def test_a_plan_wants_a_view_at_each_of_its_poses():
    made = planned(0, 0.1, 0.2)
    assert (made.cells, made.missing) == (3, [1, 2, 3])
    assert made.add(frame('first', 0.109))
    assert not made.add(frame('between', 0.149))
    assert not made.add(frame('turned', 0.2, turn=10))  # 0.3 m away things move by 52 mm
    assert not made.add(frame('again', 0.09))  # no second view of a pose
    assert made.missing == [1, 3]
    assert not made.complete
    assert made.add(frame('third', 0.201))
    assert made.add(frame('second', 0.0))
    assert made.complete
    assert made.missing == []
    assert [str(each) for each in made.left_out] == [
        'between: it is at no planned pose: pose 2 is the nearest, 49 mm away',
        'turned: it is at no planned pose: pose 3 is the nearest, 52 mm away',
        'again: first is there, 19.0 mm beside it']
    views = made.assemble().source.views
    np.testing.assert_allclose([each.camera_to_reference[0, 3] for each in views],
                               [0.109, 0.201, 0.0])


def test_planned_poses_are_as_far_apart_as_views():
    with pytest.raises(SettingsError, match='planned poses 1 and 3 are 20 mm apart'):
        planned(0, 0.1, 0.02)
    with pytest.raises(SettingsError, match='3 poses are planned, most_views is 2'):
        planned(0, 0.1, 0.2, most_views=2)


def test_a_sharp_frame_takes_the_place_of_a_blurred_one():
    made = collection()
    made.add(frame('blurred', image=BLURRED))
    assert made.add(frame('sharp', 0.001))
    assert not made.add(frame('again', 0.002))
    assert [each.name for each in made.frames] == ['sharp']
    np.testing.assert_allclose(made.assemble().source.views[0].picture, SHARP / 255, atol=1e-6)
    assert [each.name for each in made.left_out] == ['blurred', 'again']


def test_a_blurred_view_that_is_alone_at_its_place_is_named():
    """It stays: the pose is as good with it."""
    cameras = around([-20, 0, 20])
    images = [np.rint(255 * each.picture).astype(np.uint8) for each in views_of_planes(cameras)]
    noise = np.random.default_rng(1).normal(0, 1.5, images[1].shape)
    moved = np.rint(cv2.blur(images[1], (9, 1)) + noise).clip(0, 255).astype(np.uint8)
    for middle, blurred in ((images[1], 0), (moved, 1), (images[1] // 2, 0)):  # the last is dark
        made = collection()
        for number, (pose, image) in enumerate(zip(cameras, (images[0], middle, images[2]),
                                                   strict=True)):
            made.add(SweepFrame(f'frame {number + 1}', 7, image, Lens(PLANES), pose))
        found = made.assemble()
        assert len(found.source.views) == 3
        assert len(found.blurred) == blurred
        assert found.describe().startswith('3 posed views in base' + blurred * (
            '; view 1 (frame 2) is blurred: along one direction it has '))


def test_another_lens_is_resampled_to_the_first_camera():
    distorted = Lens(Pinhole(80, 60, 75.0, 75.0, 39.0, 30.0), (-0.2, 0.05, 0.0, 0.0))
    x, y = distorted.places(np.eye(3), PINHOLE)
    v, u = np.mgrid[:60, :80]
    ramp = np.stack([3 * u, 4 * v, 0 * u + 90], axis=-1).astype(np.uint8)
    made = collection(gamma=2.2)
    made.add(frame('first'))
    made.add(frame('other', 0.1, image=ramp, lens=distorted))
    found = made.assemble().source.views[1]
    assert found.pinhole == PINHOLE
    expected = np.stack([3 * x, 4 * y, 0 * x + 90], axis=-1) / 255
    np.testing.assert_allclose(found.picture, expected, atol=4e-3)


def test_pictures_are_made_smaller_and_the_memory_is_bounded():
    made = collection(shrink=4)
    made.add(frame('first'))
    assert made.assemble().source.views[0].picture.shape == (12, 16, 3)
    large = Pinhole(12_000, 9_000, 10_000.0, 10_000.0, 6000.0, 4500.0)
    image = np.broadcast_to(np.uint8(7), (9_000, 12_000, 3))
    with pytest.raises(LightFieldError, match=r'huge is given up: 1 views need 1\.5 GiB'):
        collection().add(frame('huge', image=image, lens=Lens(large)))


def test_nothing_collected_is_told_with_the_reasons():
    made = collection()
    with pytest.raises(LightFieldError, match='no frame came'):
        made.assemble()
    made.add(frame('moving', speed=1.0))
    with pytest.raises(LightFieldError, match='moving: moved by'):
        made.assemble()


def test_a_camera_that_rests_for_long_does_not_fill_the_memory():
    made = collection()
    made.add(frame('first'))
    for number in range(3000):
        made.leave_out(f'{number}', 'no pose')
    assert len(made.left_out) <= 1000
    assert made.left_out[-1].name == '2999'
    assert made.assemble().describe().startswith('1 posed views in base; left out: ')


def test_a_mask_is_that_of_each_view_as_its_lens_shows_it():
    """The image is bright where the mask leaves it out: what is left is dark."""
    mask = np.ones((48, 64), bool)
    mask[31:, 11:39] = False
    image = np.repeat(np.where(mask, 0, 255)[..., None], 3, axis=2).astype(np.uint8)
    made = ViewCollection(ViewSettings(near=0.3, apart=0.03), 'base', mask=mask)
    assert made.add(frame('first', image=image))
    assert made.add(frame('bent', 0.1, image=image, lens=Lens(PINHOLE, (-0.3, 0.1, 0.0, 0.0))))
    first, bent = made.assemble().source.views
    np.testing.assert_array_equal(first.mask, mask)
    assert (bent.mask != mask).any()
    assert bent.picture[bent.mask].max() < 0.6
    assert bent.picture[~bent.mask].min() > 0.4
    shrunk = ViewCollection(ViewSettings(near=0.3, shrink=2), 'base', mask=mask)
    shrunk.add(frame('first', image=image))
    np.testing.assert_array_equal(shrunk.assemble().source.views[0].mask,
                                  mask.reshape(24, 2, 32, 2).all(axis=(1, 3)))
    small = Lens(PINHOLE.resized(32, 24))
    with pytest.raises(LightFieldError, match='small: the mask has 64x48 px, its camera 32x24'):
        made.add(frame('small', 0.2, image=image[::2, ::2], lens=small))
    assert made.left_out[-1].name == 'small'


@pytest.mark.parametrize('reason', ['frame 12 has 4x3 px', 'frame 12: its pose is none',
                                    'frame 1 is there'])
def test_a_frame_that_is_left_out_is_named_once(reason):
    told = str(LeftOut('frame 12', reason))
    assert told.count('frame 12') == 1
    assert told.endswith(reason)
