"""Calibration from raw frames of a board, against the camera that made them."""

import functools
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from board_scene import CAMERA, POSES, BoardScene, frame_of, plain, pose
from scipy.spatial.transform import Rotation

from pmcl_ros.camera.files import read_raw_frame, write_raw_frame
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.lytro.calibrate import Calibrator, calibrate_folder
from pmcl_ros.lightfield.calibration.lytro.camera_model import PARAMETERS, Model
from pmcl_ros.runtime.errors import CalibrationError, CameraError, LightFieldError

CAPTURES = Path(__file__).parents[5] / 'shared' / 'captures'


def calibrator(scene):
    return Calibrator(scene.white(), Checkerboard(*scene.board))


@functools.cache
def plain_calibrator():
    return calibrator(plain())


@functools.cache
def views():
    return [plain_calibrator().look(f'board{index}', frame_of(index))
            for index in range(len(POSES))]


@functools.cache
def plain_result():
    return plain_calibrator().calibrate(views())


def check(result, camera, poses):
    """Within four standard deviations of the truth, and those small."""
    truth = np.array([1 / camera['focus_distance'] if name == 'focus' else camera.get(name, 0)
                      for name in PARAMETERS])
    sigma = result.uncertainty.camera
    off = np.abs(result.fit.camera - truth)
    free = sigma > 0
    assert (off[free] < 4 * sigma[free]).all()
    assert (sigma[[0, 4, 5]] < 0.003 * truth[[0, 4, 5]]).all()
    assert (sigma[2:4] < 0.2).all()
    for found, sigmas, exact in zip(result.poses, result.uncertainty.poses, poses,
                                    strict=bool(poses)):
        assert (np.abs(found - exact)[:3, 3] < 4 * sigmas[3:]).all()
        turn = Rotation.from_matrix(found[:3, :3] @ exact[:3, :3].T).magnitude()
        assert turn < 4 * np.linalg.norm(sigmas[:3])


def test_the_camera_and_the_poses_are_found():
    result = plain_result()
    check(result, CAMERA, POSES)
    assert result.fit.model == Model()
    assert result.calibration.fx == result.calibration.fy
    assert (result.calibration.k1, result.calibration.k2) == (0, 0)
    assert result.calibration.serial == 'A7'
    assert (result.calibration.zoom, result.calibration.focus) == (600, 700)
    assert result.left_out == ()


def test_another_camera_with_distortion_and_another_board():
    camera = {**CAMERA, 'fx': 205.0, 'fy': 205.0, 'cx': 38.1, 'cy': 41.0, 'baseline': 0.0026,
              'focus_distance': 0.5, 'k1': -0.3, 'k2': 0.0, 'serial': 'B2',
              'lattice': {**CAMERA['lattice'], 'pitch_px': 10.02, 'rotation': 0.006,
                          'row_step_px': 8.683}}
    board = (5, 4, 0.018)
    scene = BoardScene(camera, board)
    poses = [pose(tilt, turn, distance, middle, board) for tilt, turn, distance, middle in (
        ((0.5, 0.1), 0.2, 0.42, (0.03, -0.02)), ((-0.45, 0.2), -0.3, 0.5, (-0.05, 0.03)),
        ((0.1, -0.55), 0.1, 0.58, (0.06, 0.05)), ((0.1, 0.5), 0.0, 0.46, (-0.04, -0.05)))]
    finder = calibrator(scene)
    result = finder.calibrate([finder.look(str(index), scene.picture(each, index))
                               for index, each in enumerate(poses)])
    assert result.fit.model == Model(distortions=1)
    check(result, camera, poses)


def test_pictures_of_a_board_that_is_bent():
    """Up at its ends, by 1 mm."""
    scene = BoardScene(radius=0.45)
    finder = calibrator(scene)
    result = finder.calibrate([finder.look(str(index), scene.picture(each, index))
                               for index, each in enumerate(POSES)])
    check(result, CAMERA, [])
    x = scene.board[2] * (np.indices((5, 6))[1].ravel() - 2.5)
    exact = np.square(x) / (2 * scene.radius)
    assert result.board[:, 2] == pytest.approx(exact - exact.mean(), abs=5e-5)


def test_residuals_are_what_is_left_of_the_measurements():
    result = plain_result()
    left = result.residuals
    assert left.shape == (len(POSES), 30, 4)
    whitened = (result.fit.observations.whitening @ left[..., None])[..., 0]
    used = result.fit.observations.valid
    assert np.isfinite(left).all(axis=-1).tolist() == used.tolist()
    assert np.allclose(whitened[used], result.fit.residuals[used])


def test_of_another_camera_is_refused():
    other = BoardScene({'serial': 'Z9'})
    with pytest.raises(LightFieldError, match='Z9'):
        plain_calibrator().look('other', other.frame(np.full((800, 800), 0.3)))


def test_the_white_image_is_refused():
    with pytest.raises(LightFieldError, match='white image'):
        plain_calibrator().look('white', plain().white())


def test_boards_of_another_zoom_are_left_out():
    odd = replace(views()[1], name='zoomed', setting=(900, 700))
    result = plain_calibrator().calibrate([*views()[:1], odd, *views()[2:]])
    assert [each.name for each in result.left_out] == ['zoomed']
    assert '900' in result.left_out[0].reason
    assert len(result.boards) == len(POSES) - 1


def test_a_board_that_contradicts_the_others_is_left_out():
    corners = views()[2].corners
    bent = replace(corners, disparities=2 * corners.disparities - 0.4 * np.square(
        corners.positions - 40) / 40 ** 2)
    result = plain_calibrator().calibrate(
        [*views()[:2], replace(views()[2], name='bent', corners=bent), *views()[3:]])
    assert [each.name for each in result.left_out] == ['bent']
    check(result, CAMERA, [*POSES[:2], *POSES[3:]])


def test_two_boards_are_too_few():
    with pytest.raises(CalibrationError, match=r'2 pictures.*at least 3.*distances'):
        plain_calibrator().calibrate(views()[:2])


@pytest.mark.parametrize('number', range(len(POSES)))
def test_boards_that_do_not_tell_the_geometry_are_refused(number):
    """Three times the same pose."""
    with pytest.raises(CalibrationError, match='tilted'):
        plain_calibrator().calibrate(views()[number:number + 1] * 3)


@pytest.mark.parametrize('distance', [0.4, 0.5])
def test_boards_that_all_face_the_camera_at_one_distance_are_refused(distance):
    poses = [pose((0.0, 0.0), turn, distance, middle) for turn, middle in (
        (0.2, (0, 0)), (-0.2, (0.02, -0.01)), (0.5, (-0.02, 0.01)))]
    boards = [plain_calibrator().look(str(index), plain().picture(each, index))
              for index, each in enumerate(poses)]
    with pytest.raises(CalibrationError, match=r'the boards (determine the focal length to \d+ %|'
                       'do not separate focal length).*tilted'):
        plain_calibrator().calibrate(boards)


def test_a_folder_is_searched(tmp_path):
    for index in (0, 1, 3):
        (tmp_path / f'board{index}').mkdir()
        write_raw_frame(tmp_path / f'board{index}' / 'IMG.RAW', frame_of(index))
    (tmp_path / 'other').mkdir()
    write_raw_frame(tmp_path / 'other' / 'WHITE.RAW', plain().white())
    (tmp_path / 'other' / 'BROKEN.RAW').write_bytes(b'no picture')
    write_raw_frame(tmp_path / 'other' / 'WALL.RAW', plain().frame(0.5 * plain().light))
    write_raw_frame(tmp_path / 'other' / 'TWICE.LFP', frame_of(0))
    told = []
    result = calibrate_folder(plain().white(), tmp_path, Checkerboard(*plain().board),
                              lambda path, count, why: told.append((path.name, count, bool(why))))
    assert [each.name for each in result.boards] == [
        os.path.join(f'board{index}', 'IMG.RAW') for index in (0, 1, 3)]
    assert {Path(each.name).name for each in result.left_out} == {
        'WHITE.RAW', 'BROKEN.RAW', 'WALL.RAW', 'TWICE.LFP'}
    assert sorted(told) == sorted([('IMG.RAW', 7, False)] * 3 + [
        (name, 7, True) for name in ('WHITE.RAW', 'BROKEN.RAW', 'WALL.RAW', 'TWICE.LFP')])
    check(result, CAMERA, [POSES[index] for index in (0, 1, 3)])


def test_an_empty_folder_is_an_error(tmp_path):
    with pytest.raises(CameraError, match=r'no .* picture'):
        calibrate_folder(plain().white(), tmp_path, Checkerboard(*plain().board))


@pytest.mark.skipif(not CAPTURES.exists(), reason='no development captures here')
def test_three_boards_of_the_development_set():
    white = read_raw_frame(CAPTURES / 'white' / 'IMG.RAW.xz')
    finder = Calibrator(white, Checkerboard(10, 7, 0.011))
    names = ('board4', 'board6', 'board8')
    result = finder.calibrate([finder.look(name, read_raw_frame(CAPTURES / name / 'IMG.RAW.xz'))
                               for name in names])
    truths = [json.loads((CAPTURES / name / 'truth.json').read_text()) for name in names]
    camera = truths[0]['camera']
    found = result.calibration
    assert abs(found.fx / camera['fx'] - 1) < 0.005
    assert abs(found.baseline / camera['baseline_step'] - 1) < 0.01
    assert abs(found.focus_distance / camera['focus_distance'] - 1) < 0.01
    assert np.hypot(found.cx - camera['cx'], found.cy - camera['cy']) < 1.5
    for pose_found, truth in zip(result.poses, truths, strict=True):
        exact = np.array(truth['board_to_camera'])
        assert np.linalg.norm((pose_found - exact)[:3, 3]) < 0.002
        turn = Rotation.from_matrix(pose_found[:3, :3] @ exact[:3, :3].T).magnitude()
        assert np.degrees(turn) < 0.3
