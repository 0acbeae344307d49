import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.prior.region import Box, Region, regions_before, size_in_view, with_region
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError, SettingsError

CAMERA = Pinhole(200, 150, 300, 260, 101, 73)
WIDE = Pinhole(200, 150, 80, 90, 101, 73)


def test_near_and_far_hold_the_object():
    region = Region((0.1, 0, 0.5), (0.2, 0.3, 0.1))
    assert (region.near, region.far) == pytest.approx((0.45, 0.55))
    assert region.grown(0.1) == pytest.approx((0.35, 0.65))
    # An object larger than the way to the region: never behind the camera.
    near, far = region.grown(0.5)
    assert 0 < near < region.near
    assert far == pytest.approx(1.05)


@pytest.mark.parametrize(('center', 'size', 'message'), [
    ((0, 0, np.nan), (1, 1, 1), 'must be finite'),
    ((0, np.inf, 1), (1, 1, 1), 'must be finite'),
    ((0, 0, 1), (1, 0, 1), 'every size positive'),
    ((0, 0, 1), (1, 1, -1), 'every size positive'),
    ((0, 0, 0.3), (0.1, 0.1, 0.6), r'begins at 0\.000 m: it must lie in front of the camera'),
    ((0, 0, 0.065), (0.1, 0.1, 0.1), r'begins at 0\.015 m'),
    ((0, 0, -0.5), (0.1, 0.1, 0.1), 'in front of the camera'),
])
def test_impossible_regions_are_refused(center, size, message):
    with pytest.raises(LocalizationError, match=message):
        Region(center, size)


def test_a_box_of_another_frame_may_be_anywhere():
    box = Box((0.5, 0.1, 0.0), (0.2, 0.2, 0.1))
    assert box.contains(np.array([[0.5, 0.1, -0.04], [0.5, 0.1, 0.06]])).tolist() == [True, False]
    with pytest.raises(LocalizationError, match='must be finite'):
        Box((0, 0, np.nan), (1, 1, 1))


def test_footprint_is_the_projection_of_a_slice():
    region = Region((0.02, -0.01, 0.5), (0.1, 0.06, 0.2))
    left, top, right, bottom = region.footprint(CAMERA, 0.4)
    assert left == pytest.approx(300 * -0.03 / 0.4 + 101)
    assert right == pytest.approx(300 * 0.07 / 0.4 + 101)
    assert top == pytest.approx(260 * -0.04 / 0.4 + 73)
    assert bottom == pytest.approx(260 * 0.02 / 0.4 + 73)


@pytest.mark.parametrize(('pinhole', 'question'), [
    (CAMERA, 'are poses and region of the same frame, in metres'),
    (Pinhole(100, 75, 300, 260, 101, 73), r'the principal point \(101, 73\) is outside of '
     r'100x75 px: is the calibration of another resolution\?$')])
def test_where_no_view_sees_the_region_the_likely_reason_is_asked_for(pinhole, question):
    with pytest.raises(LocalizationError, match=f'none of the 2 views sees .*: {question}'):
        regions_before([(pinhole, np.eye(4))] * 2, PmclSettings(roi_center=(-0.6, -0.6, 0.5)),
                       0.05, 'base')


@settings(max_examples=150, deadline=None)
@given(st.sampled_from([CAMERA, WIDE]), st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
       st.floats(0.15, 1), st.tuples(*[st.floats(0.01, 0.25)] * 3), st.floats(0.005, 0.2),
       st.integers(0, 1000))
def test_window_holds_every_pixel_of_an_object_in_the_region(camera, aside, depth, size, radius,
                                                             seed):
    region = Region((*aside, depth), size)
    rng = np.random.default_rng(seed)
    # Origins on the corners or anywhere, points on the sphere about them.
    origins = region.center + (rng.random((2000, 3)) - 0.5) * size
    origins[::2] = region.center + (rng.integers(0, 2, (1000, 3)) - 0.5) * size
    points = rng.normal(size=(2000, 3))
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    seen = camera.project(origins + points)
    pixels = np.rint(seen[np.isfinite(seen).all(axis=1)])
    pixels = pixels[(pixels >= 0).all(axis=1)
                    & (pixels < (camera.width, camera.height)).all(axis=1)]
    try:
        window = region.window(camera, radius)
    except LocalizationError as error:
        assert 'outside the image (200x150)' in str(error)  # noqa: PT017
        assert len(pixels) == 0
        return
    assert window.scale == 1
    assert window.left >= 0
    assert window.top >= 0
    assert min(window.size) >= 1
    assert window.left + window.size[0] <= camera.width
    assert window.top + window.size[1] <= camera.height
    corner = np.array([window.left, window.top])
    assert ((pixels >= corner) & (pixels < corner + window.size)).all()


def test_window_is_no_larger_than_it_must_be():
    window = Region((0.02, -0.01, 0.5), (0.02, 0.02, 0.02)).window(CAMERA, 0.03)
    assert window.left == pytest.approx(300 * (0.01 - 0.03) / 0.49 + 101, abs=2)
    assert window.size[0] == pytest.approx(300 * 0.08 / 0.49, abs=3)
    assert window.size[1] == pytest.approx(260 * 0.08 / 0.49, abs=3)


@pytest.mark.parametrize('center', [(2, 0, 0.5), (-2, 0, 0.5), (0, 2, 0.5), (0, -2, 0.5)])
def test_a_region_outside_the_image_is_refused(center):
    with pytest.raises(LocalizationError, match=r'outside the image .*x right, y down'):
        Region(center, (0.1, 0.1, 0.1)).window(CAMERA, 0.05)


def test_numbers_in_messages_are_rounded():
    with pytest.raises(LocalizationError, match=re.escape('at (-2.33, 0, 0.5) m of size (0.1, 0.1'
                                                          ', 0.333) m is outside')):
        Region((-7 / 3, 0, 0.5), (0.1, 0.1, 1 / 3)).window(CAMERA, 0.05)


def test_a_region_whose_middle_is_out_of_the_image_is_told():
    camera = Pinhole(40, 30, 50.0, 50.0, 19.5, 14.5)
    assert not Region((0, 0, 0.5), (0.1, 0.1, 0.1)).middle_out_of_view(camera)
    told = Region((0.25, 0, 0.5), (0.1, 0.1, 0.1)).middle_out_of_view(camera)
    assert 'is outside of the image: at (44, 14) px of 40x30' in told
    assert '(0.25, 0, 0.5) m' in told


def test_an_object_is_as_large_as_its_longer_side_in_the_picture_and_nothing_behind_the_camera():
    camera = np.eye(4)
    camera[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]  # looks along x
    camera[:3, 3] = 0.1, 0, 0.2
    for pinhole in (CAMERA, replace(CAMERA, fx=260, fy=300)):
        assert size_in_view(0.1, (0.6, 0.1, 0.2), pinhole, camera) == pytest.approx(60)
        assert size_in_view(0.1, (-0.4, 0.1, 0.2), pinhole, camera) == 0


def test_depths_step_evenly_over_the_box():
    region = Region((0, 0, 0.5), (0.1, 0.1, 0.3))
    depths = region.depths(0.03)
    ratio = depths[1:] / depths[:-1]
    np.testing.assert_allclose(ratio, ratio[0])
    assert 1.02 < ratio[0] <= 1.03
    assert region.near < depths[0] < region.near * 1.016
    assert region.far / 1.016 < depths[-1] < region.far
    assert len(Region((0, 0, 0.5), (0.1, 0.1, 1e-6)).depths(0.03)) == 1


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=9))
def test_clip_moves_to_the_nearest_point_inside(points):
    region = Region((0.1, -0.2, 0.6), (0.2, 0.1, 0.4))
    points = np.array(points)
    clipped = region.clip(points)
    inside = (np.abs(points - region.center) <= np.array(region.size) / 2).all(axis=1)
    assert region.contains(clipped).all()
    assert region.contains(points)[inside].all()
    np.testing.assert_array_equal(clipped[inside], points[inside])
    outside = np.abs(points - region.center) > np.array(region.size) / 2 + 1e-6
    assert not region.contains(points)[outside.any(axis=1)].any()
    surface = np.array(region.center) + np.sign(points - region.center) * np.array(region.size) / 2
    np.testing.assert_allclose(clipped[outside], surface[outside])


def test_unknown_points_are_not_inside():
    region = Region((0, 0, 0.5), (1, 1, 0.5))
    assert not region.contains(np.array([[np.nan, 0, 0.5]])).any()


def box_of(cameras, radius=0.1, **given):
    """Its low and high corner."""
    settings = with_region(PmclSettings(**given), cameras, radius)
    assert not settings.region_in_view
    center, half = np.array(settings.roi_center), np.array(settings.roi_size) / 2
    return center - half, center + half


def edges(pinhole, depth):
    """What the image's borders show at a depth: left and top, right and bottom."""
    return [[(end - pinhole.cx) * depth / pinhole.fx, (bottom - pinhole.cy) * depth / pinhole.fy]
            for end, bottom in ((-0.5, -0.5), (pinhole.width - 0.5, pinhole.height - 0.5))]


def test_all_that_a_camera_sees_between_two_depths():
    low, high = box_of([(CAMERA, np.eye(4))], roi_depths=(0.3, 0.8))
    left_top, right_bottom = edges(CAMERA, 0.8)
    np.testing.assert_allclose(low, [*left_top, 0.3])
    np.testing.assert_allclose(high, [*right_bottom, 0.8])


@pytest.mark.parametrize('turn', Rotation.create_group('O').as_matrix()[:24:5])
def test_what_stands_on_a_table(turn):
    # 0.6 m away, seen from straight above; the reference frame is any along the same axes.
    camera = np.eye(4)
    camera[:3, :3], camera[:3, 3] = turn, (0.3, -0.2, 1.1)
    table = (*(camera @ [0.4, 0.1, 0.6, 1])[:3], *(turn @ [0, 0, -2.0]))
    low, high = box_of([(CAMERA, camera)], 0.12, roi_table=table)
    left_top, right_bottom = edges(CAMERA, 0.62)  # the plane may be 2 cm off
    corners = [camera @ [*left_top, 0.46, 1], camera @ [*right_bottom, 0.62, 1]]
    np.testing.assert_allclose(low, np.min(corners, axis=0)[:3], atol=1e-9)
    np.testing.assert_allclose(high, np.max(corners, axis=0)[:3], atol=1e-9)


def test_a_table_seen_at_a_slant_ends_at_the_depth_that_is_given():
    camera = np.eye(4)
    camera[:3, :3] = Rotation.from_euler('x', -100, degrees=True).as_matrix()  # up into the sky
    camera[2, 3] = 0.5
    low, high = box_of([(WIDE, camera)], 0.1, roi_table=(0, 0, 0, 0, 0, 1), roi_depths=(0.1, 2))
    assert low[2] == pytest.approx(-0.02)
    assert high[2] == pytest.approx(0.12)
    assert 1.9 < high[1] < 2.1
    with pytest.raises(LocalizationError, match=r'0\.1 to 0\.3 m away on the table .* is in view'):
        box_of([(WIDE, camera)], 0.1, roi_table=(0, 0, 0, 0, 0, 1), roi_depths=(0.1, 0.3))


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 4), st.integers(0, 1000))
def test_what_several_cameras_see_is_in_the_box_and_little_else(count, seed):
    rng = np.random.default_rng(seed)
    cameras = []
    for _ in range(count):  # about a place 0.5 m away
        pose = np.eye(4)
        pose[:3, :3] = Rotation.random(None, rng).as_matrix()
        pose[:3, 3] = rng.normal(0, 0.02, 3) - 0.5 * pose[:3, 2]
        cameras.append((CAMERA, pose))
    low, high = box_of(cameras, roi_depths=(0.3, 0.7))
    alone = [box_of([each], roi_depths=(0.3, 0.7)) for each in cameras]
    assert (low >= np.max([each[0] for each in alone], axis=0) - 1e-9).all()
    assert (high <= np.min([each[1] for each in alone], axis=0) + 1e-9).all()
    points = rng.uniform(-0.3, 0.3, (5000, 3))
    for pinhole, pose in cameras:
        seen = (points - pose[:3, 3]) @ pose[:3, :3]
        u, v = pinhole.project(seen).T
        points = points[(u >= 0) & (u < 199) & (v >= 0) & (v < 149) & (np.abs(seen[:, 2] - 0.5)
                                                                       < 0.2)]
    assert len(points)
    step = 0.035  # about the largest between places that are tried
    assert ((points >= low - step) & (points <= high + step)).all()


def test_a_box_stays_what_it_is_and_nonsense_is_refused():
    given = PmclSettings(roi_center=(0, 0, 0.4))
    assert with_region(given, [(CAMERA, np.eye(4))], 0.1) is given
    apart = np.diag([1.0, -1, -1, 1])  # back to back
    with pytest.raises(LocalizationError, match='in view of all 2 cameras'):
        box_of([(CAMERA, np.eye(4)), (CAMERA, apart)], roi_depths=(0.3, 0.8))
    for values in ({'roi_depths': (0.5, 0.4)}, {'roi_depths': (0.0, 0.4)},
                   {'roi_table': (0, 0, 1, 0, 0, 0)}):
        with pytest.raises(SettingsError, match=next(iter(values))):
            PmclSettings.make(values)
