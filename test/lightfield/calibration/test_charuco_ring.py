"""A ring of markers, drawn and seen: against truth, covered in part, behind glass."""

from hashlib import sha256
from itertools import product

import cv2
import numpy as np
import pytest
from painted_boards import on_page, page, painted, picture_of_board
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.printed_board import as_it_lies
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

has_detector = hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector')
needs_detector = pytest.mark.skipif(not has_detector, reason='OpenCV before 4.7')
PINHOLE = Pinhole(640, 480, 600, 600, 322, 238)


@pytest.mark.skipif(has_detector, reason='OpenCV from 4.7 on')
def test_an_old_opencv_is_told():
    with pytest.raises(SettingsError, match=r'ring needs OpenCV 4\.7 .*, this is 4.*corners'):
        CharucoRing(8, 11, 0.024)


def seen_from(rng, ring, distance, height):
    """A noisy picture from a height [degrees], anywhere around; where its corners are [px]."""
    turn = (Rotation.from_euler('x', 90 + height, degrees=True)
            * Rotation.from_euler('z', rng.uniform(-180, 180), degrees=True))
    pose = pose_of(turn, [0, 0, distance])
    picture = picture_of_board(ring, pose, PINHOLE)
    noisy = np.clip(picture + rng.normal(0, 3, picture.shape), 0, 255).astype(np.uint8)
    return noisy, PINHOLE.project(ring.points @ pose[:3, :3].T + pose[:3, 3])


@needs_detector
@pytest.mark.parametrize('size', [(8, 11), (5, 7), (6, 6), (20, 25)])
def test_a_ring_is_drawn_in_its_true_size(size):
    ring = CharucoRing(*size, 0.02)
    assert len(ring.points) == 2 * (sum(size) - 4)
    plane = np.concatenate([ring.points[:, :2], np.ones((len(ring.points), 1))], axis=1)
    expected = 4e3 * (plane @ on_page(ring).T)[:, :2] - 0.5
    assert ring.seen(page(ring, 4)) == pytest.approx(expected, abs=0.02)
    middle = page(ring, 4)[180:-180, 180:-180]  # from two squares and the margin on
    assert middle.min() == 255
    assert f'--ring {size[0]}x{size[1]} --square 0.02<' in ring.svg


@needs_detector
@pytest.mark.parametrize(('distance', 'height', 'least', 'most'), [
    (0.35, 50, 30, 0.07), (0.45, 60, 25, 0.07), (0.45, 35, 20, 0.16)])
def test_corners_have_no_common_error(distance, height, least, most):
    ring, rng, every = CharucoRing(8, 11, 0.024), np.random.default_rng(1), []
    for _ in range(6):
        picture, exact = seen_from(rng, ring, distance, height)
        off = ring.seen(picture) - exact
        off = off[np.isfinite(off[:, 0])]
        assert len(off) >= least
        assert np.sqrt(np.square(off).mean()) < most
        every.append(off)
    assert np.abs(np.concatenate(every).mean(axis=0)).max() < 0.01


@needs_detector
@pytest.mark.parametrize(('blur', 'light', 'least'), [
    (1.2, 1.0, 25), (1.6, 1.0, 20), (0.8, 2.0, 20), (0.5, 0.1, 25)])
def test_a_ring_is_seen_blurred_overexposed_and_dark(blur, light, least):
    ring, rng = CharucoRing(8, 11, 0.024), np.random.default_rng(2)
    for turn in range(0, 360, 60):
        pose = pose_of(Rotation.from_euler('xz', [145, turn], degrees=True), [0, 0, 0.4])
        exact = PINHOLE.project(ring.points @ pose[:3, :3].T + pose[:3, 3])
        exposed = light * picture_of_board(ring, pose, PINHOLE).astype(np.float32)
        picture = cv2.GaussianBlur(exposed, (0, 0), blur)
        picture = np.clip(picture + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)
        seen = as_it_lies(ring, {'a': ring.seen(picture)}, PINHOLE).pictures['a']
        off = np.linalg.norm(seen - exact, axis=1)
        assert np.isfinite(off).sum() >= least
        assert np.nanmedian(off) < 0.3


@needs_detector
def test_a_ring_is_not_seen_in_clutter():
    ring, rng = CharucoRing(8, 11, 0.024), np.random.default_rng(3)
    for number in range(12):
        coarse = rng.uniform(20, 230, (60, 80)).astype(np.float32)
        picture = cv2.resize(coarse, (640, 480), interpolation=(
            cv2.INTER_NEAREST, cv2.INTER_CUBIC)[number % 2]).clip(0, 255).astype(np.uint8)
        assert ring.seen(picture) is None


@needs_detector
def test_what_is_covered_is_not_seen_and_the_rest_is():
    ring, rng = CharucoRing(8, 11, 0.024), np.random.default_rng(2)
    picture, exact = seen_from(rng, ring, 0.45, 50)
    x, y = exact[np.argmax(exact[:, 1])].astype(int)
    picture[y - 60:, x - 60:x + 60] = 90
    corners = ring.seen(picture)
    shown = np.isfinite(corners[:, 0])
    covered = (np.abs(exact[:, 0] - x) < 60) & (exact[:, 1] > y - 60)
    assert covered.any()
    assert not shown[covered].any()
    assert shown.sum() >= 15
    assert np.abs(corners - exact)[shown].max() < 0.6
    picture[:, 200:] = 90
    assert ring.seen(picture) is None
    assert ring.seen(np.full((480, 640), 90, np.uint8)) is None
    assert ring.seen(page(CharucoRing(6, 6, 0.03), 4)) is None  # the markers of another ring


@pytest.mark.skipif(not has_detector or not hasattr(cv2.aruco.CharucoParameters(), 'checkMarkers'),
                    reason='this OpenCV refuses all markers where one is read twice')
def test_a_marker_that_is_seen_at_a_second_place_hides_none():
    ring, rng = CharucoRing(8, 11, 0.024), np.random.default_rng(6)
    picture, exact = seen_from(rng, ring, 0.45, 60)
    whole = ring.seen(picture)
    x, y = exact.mean(axis=0).astype(int)
    marker = page(ring, 2.5)[15:75, 75:135]  # the second square of the first row
    picture[y - 30:y + 30, x - 30:x + 30] = marker
    shown = np.isfinite(ring.seen(picture)[:, 0])
    assert shown.sum() >= np.isfinite(whole[:, 0]).sum() - 2
    assert np.abs(ring.seen(picture) - exact)[shown].max() < 0.6


@needs_detector
def test_two_rings_alike_are_refused():
    """Either could be taken, another one in the next picture."""
    ring = CharucoRing(6, 7, 0.024)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        turn = Rotation.from_euler('xz', [180 + rng.uniform(-30, 30), rng.uniform(-30, 30)],
                                   degrees=True)
        pose = pose_of(turn, [-0.1, 0, 0.7])
        beside = pose @ pose_of(Rotation.from_euler('z', 15, degrees=True), [0.2, 0, 0])
        picture = picture_of_board(ring, pose, PINHOLE)
        assert ring.seen(picture) is not None
        other = painted(picture, CharucoRing(5, 7, 0.024), beside, PINHOLE)
        assert ring.seen(other) is not None
        with pytest.raises(LightFieldError, match='there are two rings of --ring 6x7 --square'):
            ring.seen(painted(picture, ring, beside, PINHOLE))


@needs_detector
def test_one_side_of_a_ring_is_not_enough():
    ring = CharucoRing(8, 14, 0.02)
    picture = page(ring, 4)
    picture[:, 180:] = 255
    assert ring.seen(picture) is None


@needs_detector
def test_a_ring_that_was_printed_stays_what_it_is():
    drawn = page(CharucoRing(8, 11, 0.024), 5)
    assert sha256(drawn.tobytes()).hexdigest()[:16] == '84dc64306b49943f'


@needs_detector
@pytest.mark.parametrize('printed', [(8, 11), (6, 8)])
def test_a_ring_is_not_taken_for_one_of_other_numbers(printed):
    """Whose middle is elsewhere. The second picture shows a part of the ring only."""
    ring, rng = CharucoRing(*printed, 0.024), np.random.default_rng(4)
    pictures = [seen_from(rng, ring, 0.45, 50)[0], seen_from(rng, ring, 0.45, 70)[0]]
    pictures[1][:, 400:] = 90
    assert all(ring.seen(each) is not None for each in pictures)
    columns, rows = printed
    near = product(range(columns - 1, columns + 2), range(rows - 2, rows + 3))
    for other in {(rows, columns), *near} - {printed}:
        assert all(CharucoRing(*other, 0.024).seen(each) is None for each in pictures), other


@needs_detector
def test_a_corner_of_which_one_marker_is_hidden_is_seen():
    ring = CharucoRing(8, 11, 0.02)
    exact = ring.seen(page(ring, 4))
    for row, column in ((0, 1), (0, 3), (5, 0), (10, 7)):
        picture = page(ring, 4)
        left, top = 20 + 80 * column, 20 + 80 * row
        picture[top:top + 80, left:left + 80] = 255
        assert ring.seen(picture) == pytest.approx(exact, abs=0.02)


@needs_detector
def test_corners_behind_glass_are_left_out():
    ring, rng = CharucoRing(8, 11, 0.024), np.random.default_rng(3)
    picture, exact = seen_from(rng, ring, 0.45, 50)
    corners = ring.seen(picture)
    behind = np.argsort(np.linalg.norm(exact - exact[0], axis=1))[:7]
    behind = behind[np.isfinite(corners[behind, 0])]
    assert len(behind) > 3
    aside = corners.copy()
    aside[behind] += rng.uniform(1.5, 6, (len(behind), 2))
    left = as_it_lies(ring, {'a': aside}, PINHOLE).pictures['a']
    assert np.isnan(left[behind]).all()
    others = np.setdiff1d(np.arange(len(exact)), behind)
    np.testing.assert_array_equal(left[others], corners[others])
    np.testing.assert_array_equal(as_it_lies(ring, {'a': corners}, PINHOLE).pictures['a'], corners)
    assert as_it_lies(ring, {'a': np.full(corners.shape, 100.0)}, PINHOLE).pictures == {}


@needs_detector
@pytest.mark.parametrize(('values', 'message'), [
    ((4, 11, 0.024), '4x11 squares cannot be used; it has 5 or more'),
    ((8, 4, 0.024), '8x4 squares cannot be used; it has 5 or more'),
    ((8, 63, 0.024), 'an area of 500 at most'),
    ((8, 11, 1.0), 'squares of 1.0 m are impossible'),
    ((8, 11, 1e-4), 'squares of 0.0001 m are impossible')])
def test_no_ring(values, message):
    with pytest.raises(SettingsError, match=message):
        CharucoRing(*values)
    with pytest.raises(SettingsError, match="ring '8-11' is not like 8x11"):
        CharucoRing.parse('8-11', 0.024)
    assert CharucoRing.parse(' 8X11', 0.024) == CharucoRing(8, 11, 0.024)
