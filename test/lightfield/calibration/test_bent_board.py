"""Boards on paper that is bent, seen in pictures while they rest: against truth."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from painted_boards import picture_of_sheet
from rolled_sheets import rolled
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.lightfield.calibration.bent_board import bent
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.fixed_cameras import camera_at_board
from pmcl_ros.lightfield.calibration.intrinsics import fit_intrinsics
from pmcl_ros.lightfield.calibration.printed_board import as_it_lies
from pmcl_ros.runtime.errors import LightFieldError

HAS_DETECTOR = hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector')
needs_detector = pytest.mark.skipif(not HAS_DETECTOR, reason='OpenCV before 4.7')
BOARD = Checkerboard(10, 7, 0.025)
MIDDLE = BOARD.points.mean(axis=0)
PINHOLE = Pinhole(1280, 960, 1200, 1200, 645, 475)
NOISE = 0.15  # px
TOP = 3e-3  # m


def curled(places):
    """Along a slanted line, away from the middle."""
    return TOP * np.square(((places - MIDDLE[:2]) @ [0.8, 0.6]) / 0.13)


def one_edge(places):
    return TOP * np.square(np.maximum((places - MIDDLE[:2]) @ [1, 0] / 0.1125 - 0.2, 0) / 0.8)


def one_corner(places):
    x, y = ((places - MIDDLE[:2]) / [0.1125, 0.075]).T
    return TOP * np.square(np.maximum((x + y) / 2 - 0.2, 0) / 0.8)


def flat(places):
    return np.zeros(len(places))


BENDS = [curled, one_edge, one_corner]


def sheet(height):
    points = BOARD.points.copy()
    points[:, 2] = height(points[:, :2])
    return points


def views(rng, count, distance=0.45):
    """(count, 4, 4) board to cameras, which look at its middle around it."""
    found = []
    for number in range(count):
        turn = (Rotation.from_euler('z', rng.uniform(-180, 180), degrees=True)
                * Rotation.from_euler('x', rng.uniform(25, 55), degrees=True)
                * Rotation.from_euler('z', 360 / count * (number + rng.uniform(0, 0.5)),
                                      degrees=True))
        found.append(pose_of(turn, [0, 0, distance] - turn.apply(MIDDLE)))
    return np.array(found)


def seen(rng, poses, points, noise=NOISE, pinhole=PINHOLE):
    return {f'{number}.png': pinhole.project(points @ pose[:3, :3].T + pose[:3, 3])
            + rng.normal(0, noise, (len(points), 2)) for number, pose in enumerate(poses)}


def off_plane(points):
    """z (m,) from the plane through the points."""
    plane = np.c_[points[:, :2], np.ones(len(points))]
    return points[:, 2] - plane @ np.linalg.lstsq(plane, points[:, 2], rcond=None)[0]


def misfit(poses, cameras):
    """Largest distance [px] of the pictures of a place above the board from one place."""
    place, rows, pixels = MIDDLE + np.array([0, 0, 0.06]), [], []
    for pose, camera in zip(poses, cameras, strict=True):
        x, y = PINHOLE.project(pose[:3, :3] @ place + pose[:3, 3])
        sees = PINHOLE.matrix @ inverse(camera)[:3]
        rows += [x * sees[2] - sees[0], y * sees[2] - sees[1]]
        pixels.append([x, y])
    found = np.linalg.svd(np.array(rows))[2][-1]
    back = inverse(np.array(cameras))
    again = PINHOLE.project(back[:, :3, :3] @ (found[:3] / found[3]) + back[:, :3, 3])
    return float(np.linalg.norm(again - pixels, axis=1).max())


@pytest.mark.parametrize('height', [flat, *BENDS])
@pytest.mark.parametrize('count', [2, 4])
def test_the_bend_is_found(height, count):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        found = bent(seen(rng, views(rng, count), sheet(height)), BOARD.points, PINHOLE)
        heights = np.column_stack([BOARD.points[:, :2], found.points[:, 2]])
        assert off_plane(heights) == pytest.approx(found.points[:, 2], abs=1e-12)
        assert found.points[:, 2] == pytest.approx(off_plane(sheet(height)), abs=0.25e-3)
        assert found.pixels == pytest.approx(np.full(count, NOISE * np.sqrt(2)), rel=0.25)


def test_a_bend_is_as_exact_as_is_told():
    squares = []
    for seed in range(30):
        rng = np.random.default_rng(100 + seed)
        found = bent(seen(rng, views(rng, 4), sheet(curled)), BOARD.points, PINHOLE)
        off = found.points[:, 2] - off_plane(sheet(curled))
        squares.append(np.square(off) / np.square(found.heights).sum(axis=1))
    assert 0.5 < np.mean(squares) < 1.3  # the prior, of flat sheets, is not that of this one


@pytest.mark.parametrize('height', BENDS)
def test_cameras_agree_on_what_stands_on_a_sheet_that_is_bent(height):
    by_flat, by_bent = [], []
    for seed in range(5):
        rng = np.random.default_rng(200 + seed)
        poses = views(rng, 3)
        pictures = seen(rng, poses, sheet(height))
        wrong = rng.permutation(len(BOARD.points))[:10]  # as behind glass, elsewhere in each
        pictures['1.png'][wrong] += rng.uniform(2, 8, (10, 2))
        for points, each in ((BOARD.points, by_flat),
                             (bent(pictures, BOARD.points, PINHOLE).points, by_bent)):
            right = {name: corners for name, corners in pictures.items() if name != '1.png'}
            right['1.png'] = np.where(np.isin(np.arange(70), wrong)[:, None], np.nan,
                                      pictures['1.png'])
            each.append(misfit(poses[[0, 2, 1]], [
                camera_at_board({name: corners}, points, PINHOLE).camera
                for name, corners in right.items()]))
    assert max(by_bent) < 0.5
    assert np.median(by_bent) < 0.2
    assert np.median(by_flat) > 4 * np.median(by_bent)


def test_errors_of_cameras_have_those_of_the_bend():
    """In a single picture of a sheet that may be bent."""
    squares = {'flat': [], 'bent': []}
    for seed in range(40):
        rng = np.random.default_rng(300 + seed)
        poses = views(rng, 2)
        pictures = seen(rng, poses, BOARD.points)
        errors = []
        for name, corners in pictures.items():
            found = as_it_lies(BOARD, {name: corners}, PINHOLE)
            at = camera_at_board(found.pictures, found.points, PINHOLE, found.heights)
            exact = camera_at_board(found.pictures, found.points, PINHOLE)
            more = at.covariance - exact.covariance
            assert np.linalg.eigvalsh(more).min() > -1e-9 * np.abs(more).max()
            errors.append((exact, at))
        for key, number in (('flat', 0), ('bent', 1)):
            for pose, each in zip(poses, errors, strict=True):
                off = (each[number].camera @ pose)[:3, 3]
                squares[key].append(np.square(off).sum() / 3
                                    / each[number].sigma_beside(BOARD.points)[0] ** 2)
    assert np.mean(squares['bent']) < 1.3
    assert np.mean(squares['bent']) < np.mean(squares['flat'])


@pytest.mark.parametrize('height', [flat, *BENDS])
def test_a_camera_is_calibrated_by_a_sheet_that_is_bent(height):
    rng = np.random.default_rng(4)
    poses = views(rng, 12, 0.4)
    found = fit_intrinsics(seen(rng, poses, sheet(height)), BOARD.points, 1280, 960)
    assert found.left_out == ()
    exact = np.array([1200, 1200, 645, 475, 0, 0, 0, 0])
    assert np.abs((found.camera - exact) / found.sigma).max() < 4
    assert found.sigma[:4] == pytest.approx(np.zeros(4), abs=2.5)
    assert found.pixels.max() < 0.3
    assert found.board[:, 2] == pytest.approx(off_plane(sheet(height)), abs=0.1e-3)


@pytest.mark.parametrize(('degrees', 'shape'), [(0, 'gutter'), (50, 'gutter'), (0, 'curled')])
@pytest.mark.parametrize('height', [3e-3, 1e-2])
def test_errors_of_a_camera_hold_by_a_sheet_that_is_rolled(degrees, shape, height):
    """Its corners come closer together: that passed for distortion."""
    off, sheet_now = [], rolled(BOARD.points, height, degrees, shape)
    for seed in range(6):
        rng = np.random.default_rng(400 + seed)
        found = fit_intrinsics(seen(rng, views(rng, 12, 0.4), sheet_now), BOARD.points, 1280, 960)
        off.append((found.camera - [1200, 1200, 645, 475, 0, 0, 0, 0]) / found.sigma)
    assert np.sqrt(np.square(off).mean(axis=0)).max() < 2
    assert np.sqrt(np.square(off).mean()) < 1.4


@pytest.mark.parametrize('height', [flat, *BENDS])
def test_z_is_that_of_the_table(height):
    """Of a checkerboard z points into it."""
    rng = np.random.default_rng(6)
    found = as_it_lies(BOARD, seen(rng, views(rng, 4), sheet(height) * [1, 1, -1]), PINHOLE)
    assert found.points[:, 2] == pytest.approx(-height(BOARD.points[:, :2]), abs=0.4e-3)


@pytest.mark.parametrize('shape', ['gutter', 'slanted gutter', 'saddle'])
def test_a_sheet_that_may_rock_lies_level(shape):
    """Which way it would tilt, the noise alone would tell."""
    x, y = ((BOARD.points[:, :2] - MIDDLE[:2]) / [0.1125, 0.075]).T
    z = -TOP * {'gutter': x ** 2, 'slanted gutter': (0.8 * x + 0.6 * y) ** 2,
                'saddle': x * y + 1}[shape]
    for seed in range(5):
        rng = np.random.default_rng(700 + seed)
        points = np.concatenate([BOARD.points[:, :2], z[:, None]], axis=1)
        found = as_it_lies(BOARD, seen(rng, views(rng, 4), points), PINHOLE)
        assert found.points[:, 2] == pytest.approx(z, abs=0.5e-3)


@pytest.mark.parametrize('height', BENDS)
def test_a_picture_of_another_zoom_is_left_out_beside_a_sheet_that_is_bent(height):
    zoomed = replace(PINHOLE, fx=1.1 * PINHOLE.fx, fy=1.1 * PINHOLE.fy)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        pictures = seen(rng, views(rng, 11, 0.4), sheet(height))
        pictures['zoomed.png'], = seen(rng, views(rng, 1, 0.4), sheet(height),
                                       pinhole=zoomed).values()
        found = fit_intrinsics(pictures, BOARD.points, 1280, 960)
        assert found.left_out == ('zoomed.png',)
        assert found.pinhole.fx == pytest.approx(PINHOLE.fx, abs=4 * found.sigma[0])


@pytest.mark.parametrize('height', [flat, *BENDS])
@pytest.mark.parametrize('zoom', [1.06, 1.1])
def test_two_zooms_half_and_half_are_named_beside_a_sheet_that_is_bent(height, zoom):
    zoomed = replace(PINHOLE, fx=zoom * PINHOLE.fx, fy=zoom * PINHOLE.fy)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        pictures = seen(rng, views(rng, 12, 0.4), sheet(height))
        longer = seen(rng, views(rng, 12, 0.4), sheet(height), pinhole=zoomed)
        pictures |= {f'{number}.png': longer[f'{number}.png'] for number in range(6)}
        with pytest.raises(LightFieldError) as caught:
            fit_intrinsics(pictures, BOARD.points, 1280, 960)
        one, other = (', '.join(f'{number}.png' for number in numbers)
                      for numbers in (range(6, 12), range(6)))
        assert re.match(fr'{one} were taken with a focal length of about 1[12]\d\d px, {other} of '
                        r'about 1[23]\d\d px: was the zoom', str(caught.value)), caught.value


@needs_detector
@pytest.mark.parametrize('shift', [0, 1.5, 4])
def test_a_ring_may_be_curled_along_a_side(shift):
    """Most of its corners, of two sides, are then on one plane; those behind glass are not."""
    ring = CharucoRing(8, 11, 0.024)
    points = ring.points.copy()
    points[:, 2] = TOP * np.square(points[:, 1] / 0.12)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        poses = [pose_of(Rotation.from_euler('x', 180, degrees=True) * Rotation.from_matrix(
            each[:3, :3]), [0, 0, 0.45]) for each in views(rng, 3)]
        pictures, behind = seen(rng, poses, points), {}
        for name, corners in pictures.items():
            behind[name] = np.argsort(np.linalg.norm(corners - rng.choice(corners), axis=1))[:5]
            corners[behind[name]] += shift * rng.choice([-1, 1], 2)
        found = as_it_lies(ring, pictures, PINHOLE)
        assert found.points[:, 2] == pytest.approx(points[:, 2], abs=0.5e-3)
        for name, corners in found.pictures.items():
            shown = np.isfinite(corners[:, 0])
            assert shown[behind[name]].any() == (shift == 0)
            assert shown.sum() >= 23
        assert len(found.pictures) == 3


@needs_detector
@pytest.mark.parametrize('along', [0, 1])
def test_a_single_picture_of_a_ring_that_is_curled_along_a_side_tells_so(along):
    """Behind nothing: all of its corners are those of a bend."""
    ring = CharucoRing(8, 11, 0.024)
    points, places = ring.points.copy(), ring.points[:, along]
    points[:, 2] = TOP * np.square(places / places.max())
    off = []
    for seed in range(8):
        rng = np.random.default_rng(800 + seed)
        turn = (Rotation.from_euler('x', rng.uniform(130, 150), degrees=True)
                * Rotation.from_euler('z', rng.uniform(-180, 180), degrees=True)).as_matrix()
        pose = pose_of(turn, [0, 0, 0.45])
        found = as_it_lies(ring, seen(rng, [pose], points), PINHOLE)
        at = inverse(camera_at_board(found.pictures, found.points, PINHOLE).camera)
        place = np.array([0, 0, 0.06])  # of an object in the middle
        seen_at, there = (PINHOLE.project(each[:3, :3] @ place + each[:3, 3])
                          for each in (at, pose))
        off.append(np.linalg.norm(seen_at - there))
    assert np.median(off) < 0.25  # px


def test_in_pictures():
    small, off = Pinhole(640, 480, 600, 600, 322, 238), []

    def up(places):
        return -curled(places)

    for seed in range(8):
        found = as_it_lies(BOARD, {
            str(number): BOARD.seen(picture_of_sheet(BOARD, pose, small, up))
            for number, pose in enumerate(views(np.random.default_rng(seed), 2, 0.5))}, small)
        off.append(np.abs(found.points[:, 2] - sheet(up)[:, 2]).max())
    assert max(off) < 0.12e-3
    assert np.median(off) < 0.08e-3


STRAIGHT = {'board': BOARD}
if HAS_DETECTOR:
    STRAIGHT |= {'ring': CharucoRing(8, 11, 0.024), 'square': CharucoRing(9, 9, 0.02)}


@pytest.mark.parametrize('count', [1, 3])
@pytest.mark.parametrize('board', STRAIGHT.values(), ids=STRAIGHT)
def test_exact_corners_of_boards_that_are_straight_before_the_camera_tell_a_flat_sheet(board,
                                                                                      count):
    """As of a simulation without noise, whose camera looks down at the middle of the board."""
    rng = np.random.default_rng(count)
    for _ in range(10):
        poses = {}
        for number in range(count):
            turn = Rotation.from_euler('xz', [0 if board.up < 0 else 180,
                                              90 * rng.integers(4)], degrees=True).as_matrix()
            if number:
                turn = Rotation.from_euler('y', 30 * number, degrees=True).as_matrix() @ turn
            poses[f'{number}.png'] = pose_of(
                turn, [0, 0, rng.choice([0.4, 0.5, 0.6])] - turn @ board.points.mean(axis=0))
        found = as_it_lies(board, {
            name: PINHOLE.project(board.points @ pose[:3, :3].T + pose[:3, 3])
            for name, pose in poses.items()}, PINHOLE)
        np.testing.assert_allclose(found.points, board.points, atol=1e-6)
        assert 0 < np.linalg.norm(found.heights, axis=1).max() < 2e-4
        assert [*found.pictures] == [*poses]
        for name, pose in poses.items():
            at = camera_at_board({name: found.pictures[name]}, found.points, PINHOLE,
                                 found.heights)
            np.testing.assert_allclose(at.camera, inverse(pose), atol=1e-5)
            assert np.linalg.eigvalsh(at.covariance).min() > 0
