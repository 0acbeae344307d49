"""`pmcl calibrate`, as users call it, on files of a made-up camera."""

import json
import shutil

import cv2
import numpy as np
import pytest
from board_scene import CAMERA, POSES, frame_of, plain
from command_line import pmcl

from pmcl_ros.camera.files import read_raw_frame, write_raw_frame
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decode import Decoder

BOARD = ('--corners', '6x5', '--square', '0.012')


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A white image and three pictures of a board, each in its own folder."""
    folder = tmp_path_factory.mktemp('boards')
    for name, frame in (('white', plain().white()), *((f'board{k}', frame_of(k))
                                                      for k in (0, 1, 3))):
        (folder / name).mkdir()
        write_raw_frame(folder / name / 'IMG.RAW', frame)
    return folder


def calibrate(folder, out, *more, status=0):
    return pmcl('calibrate', '--white', folder / 'white/IMG.RAW', '--boards', folder, *more,
                '--out', out, status=status)


def test_a_calibration_and_its_report_are_written(folder, tmp_path):
    out = tmp_path / 'new' / 'camera.yaml'
    done = calibrate(folder, out, *BOARD)
    assert 'white' in done.stderr
    assert 'baseline' in done.stdout
    calibration = Calibration.load(out)
    report = json.loads(out.with_suffix('.json').read_text())
    assert report['calibration'] == calibration.model_dump(mode='json')
    for name in ('fx', 'cx', 'cy', 'baseline', 'focus_distance'):
        sigma = report['standard_deviation'][name]
        assert abs(getattr(calibration, name) - CAMERA[name]) < 4 * sigma
    assert [each['picture'].split('/')[0] for each in report['boards']] == [
        'board0', 'board1', 'board3']
    for each, k in zip(report['boards'], (0, 1, 3), strict=True):
        assert np.abs(np.array(each['board_to_camera']) - POSES[k]).max() < 1e-3
    bend = np.abs(np.array(report['board_as_it_lies'])[:, 2]).max()
    assert bend < 1e-4
    assert f'are up to {1e3 * bend:.2f} mm off a plane' in out.read_text()
    assert [each['name'].split('/')[0] for each in report['left_out']] == ['white']
    picture = cv2.imread(str(out.with_suffix('.png')))
    assert picture.shape[0] > 300
    assert picture.std() > 10
    decoder = Decoder(calibration, read_raw_frame(folder / 'white/IMG.RAW'))
    assert decoder.decode(frame_of(0)).views.any()


def test_a_camera_is_called_by_its_name(folder, tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path))
    raw = folder / 'board0/IMG.RAW'
    call = 'decode', raw, '--white', folder / 'white/IMG.RAW', '--out', tmp_path / 'out'
    done = pmcl(*call, '--calibration', 'kitchen', status=2)
    assert 'pmcl calibrate --camera kitchen makes one' in done.stderr
    given = '--white', folder / 'white/IMG.RAW', '--boards', folder, *BOARD
    assert '--out C.yaml, or --camera NAME' in pmcl('calibrate', *given, status=2).stderr
    for name in ('../kitchen', 'a b', 'kitchen.yaml'):
        assert 'is no name' in pmcl('calibrate', *given, '--camera', name, status=2).stderr
    pmcl('calibrate', *given, '--camera', 'kitchen')
    assert (tmp_path / 'pmcl_ros/cameras/kitchen.yaml').is_file()
    assert 'views of' in pmcl(*call, '--calibration', 'kitchen').stderr
    assert (tmp_path / 'out/views.npz').is_file()


def test_what_is_missing_is_told_in_one_message(folder, tmp_path):
    done = calibrate(folder, tmp_path / 'C.yaml', '--corners', '10x7', '--square', '0.012',
                     status=1)
    assert 'at least 3 are needed' in done.stderr
    assert 'no complete board of 10x7' in done.stderr
    assert not (tmp_path / 'C.yaml').exists()


def test_a_place_that_cannot_be_written_is_told_before_the_work(folder, tmp_path):
    (tmp_path / 'file').write_text('')
    done = calibrate(folder, tmp_path / 'file' / 'C.yaml', *BOARD, status=1)
    assert str(tmp_path / 'file') in done.stderr
    assert 'left out' not in done.stderr


def test_impossible_corners_are_told(folder, tmp_path):
    done = calibrate(folder, tmp_path / 'C.yaml', '--corners', 'ten', '--square', '0.012',
                     status=1)
    assert 'ten' in done.stderr


def test_a_damaged_picture_does_not_choose_the_white_image(folder, tmp_path):
    """The first by name cannot be read; the white image in a folder is that of the others."""
    shutil.copytree(folder, tmp_path / 'all')
    (tmp_path / 'all' / 'A').mkdir()
    (tmp_path / 'all' / 'A' / 'A.RAW').write_bytes(b'')
    (tmp_path / 'all' / 'A' / 'A.TXT').write_text('no metadata')
    done = pmcl('calibrate', '--white', tmp_path / 'all' / 'white', '--boards', tmp_path / 'all',
                *BOARD, '--out', tmp_path / 'camera.yaml')
    assert 'white image: IMG.RAW' in done.stderr
    assert 'left out' in done.stderr
    assert (tmp_path / 'camera.yaml').exists()
