"""From pictures of a board to a camera, its poses and an object's pose, as users call commands."""

import json
import os
import re
import shutil
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import trimesh
import yaml
from command_line import pmcl
from painted_boards import painted, picture_of_board
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.readers.posed_views import ViewCamera, ViewsFile
from pmcl_ros.lightfield.readers.read import read_source

CAMERA = {'width': 400, 'height': 300, 'fx': 375.0, 'cx': 198.0, 'cy': 152.0}
PINHOLE = Pinhole(400, 300, 375, 375, 198, 152)
LARGE, SMALL = Checkerboard(10, 7, 0.02), Checkerboard(6, 5, 0.012)


def test_a_board_is_drawn_in_its_true_size(tmp_path):
    out = tmp_path / 'made' / 'board.svg'
    pmcl('board', '--corners', '10x7', '--square', 0.02, '-o', out)
    drawn = ElementTree.parse(out).getroot()
    assert (drawn.get('width'), drawn.get('height')) == ('260mm', '200mm')
    picture = np.full((400, 520), 255, np.uint8)  # half a millimetre a pixel
    for each in drawn:
        x, y, width, height = (round(2 * float(each.get(name)))
                               for name in ('x', 'y', 'width', 'height'))
        picture[y:y + height, x:x + width] = 0
    corners = LARGE.seen(picture)
    assert corners == pytest.approx(2e3 * (LARGE.points[:, :2] + 0.04) - 0.5, abs=0.05)
    done = pmcl('board', '--corners', '9x7', '--square', 0.02, '-o', tmp_path / 'b.svg', status=1)
    assert 'looks the same upside down' in done.stderr
    done = pmcl('board', '--corners', '10x7', '--square', 0.02, '-o', tmp_path / 'b.png', status=2)
    assert 'give the name of an SVG' in done.stderr
    assert not (tmp_path / 'b.png').exists()


@pytest.fixture(scope='module')
def boards(tmp_path_factory):
    """A folder of pictures of the large board, and one of something else."""
    folder, rng = tmp_path_factory.mktemp('boards'), np.random.default_rng(1)
    for number in range(9):
        turn = Rotation.from_euler('xyz', [*rng.uniform(-35, 35, 2), rng.uniform(-20, 20)],
                                   degrees=True).as_matrix()
        place = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.35, 0.45)])
        seen = picture_of_board(LARGE, pose_of(turn, place - turn @ LARGE.points.mean(axis=0)),
                                PINHOLE)
        cv2.imwrite(str(folder / f'{number}.png'), seen)
    cv2.imwrite(str(folder / 'wall.jpg'), np.full((300, 400), 90, np.uint8))
    (folder / '._0.png').write_bytes(b'a note of macOS about 0.png')
    return folder


@pytest.fixture(scope='module')
def camera(boards, tmp_path_factory):
    out = tmp_path_factory.mktemp('camera') / 'made' / 'phone.yaml'
    done = pmcl('calibrate-camera', boards, '--corners', '10x7', '--square', 0.02, '-o', out)
    assert 'wall.jpg: no complete board' in done.stderr
    assert done.stdout.count('.png: corners 0.') == 9
    return out


def test_a_camera_is_calibrated(camera):
    found = ViewCamera.load(camera)
    assert (found.width, found.height) == (400, 300)
    assert [found.fx, found.fy] == pytest.approx([375, 375], rel=0.002)
    assert [found.cx, found.cy] == pytest.approx([198, 152], abs=0.8)
    assert np.abs(found.distortion).max() < 0.01


def test_pictures_of_two_zooms_are_refused(boards, tmp_path):
    for number in range(8):
        seen = cv2.imread(str(boards / f'{number}.png'))
        if number > 3:  # 15 % longer
            seen = cv2.resize(seen, None, fx=1.15, fy=1.15, interpolation=cv2.INTER_CUBIC)
            seen = seen[22:322, 30:430]
        cv2.imwrite(str(tmp_path / f'{number}.jpg'), seen)
    done = pmcl('calibrate-camera', tmp_path, '--corners', '10x7', '--square', 0.02, '-o',
                tmp_path / 'c.yaml', status=1)
    assert not (tmp_path / 'c.yaml').exists()
    told = re.search(r'0.jpg, 1.jpg, 2.jpg, 3.jpg were .* about (\d+) px, 4.jpg, 5.jpg, 6.jpg, '
                     r'7.jpg of about (\d+) px: was the zoom or the focus moved', done.stderr)
    assert told, done.stderr
    assert [int(each) for each in told.groups()] == pytest.approx([375, 431], rel=0.01)


@pytest.fixture(scope='module')
def placed(tmp_path_factory):
    """A capture of posed views, and the same pictures with a board on the table beside it.

    And the board's pose in the frame of the capture.
    """
    folder = tmp_path_factory.mktemp('placed')
    (folder / 'camera.yaml').write_text(yaml.safe_dump(CAMERA))
    pmcl('scenes', 'render', '--camera', folder / 'camera.yaml', '--cameras', 'arc:3:40',
         '--samples', 2, '--kind', 'opaque', '--seed', 3, '--count', 1, '-o', folder)
    capture, pictures = folder / '000003', folder / 'pictures'
    pictures.mkdir()
    views = read_source(capture).views
    pose = Truth.load(capture / 'truth.json').pose
    standing = trimesh.load_mesh(capture / 'model.obj').apply_transform(pose)
    place = [*pose[:2, 3], standing.bounds[0, 2]] - 0.12 * views[1].camera_to_reference[:3, 0]
    turn = Rotation.from_euler('zx', [-100, 180], degrees=True).as_matrix()  # z is down
    board = pose_of(turn, place - turn @ SMALL.points.mean(axis=0))
    for each in views:
        seen = painted(each.displayed(), SMALL, inverse(each.camera_to_reference) @ board, PINHOLE)
        cv2.imwrite(str(pictures / each.name), seen[..., ::-1])
    return capture, pictures, board


def test_an_object_is_found_by_a_board_beside_it(placed, camera):
    capture, pictures, board = placed
    done = pmcl('board-poses', pictures, '--camera', camera, '--corners', '6x5', '--square', 0.012)
    assert done.stdout.count(' mm away, corners 0.') == 3
    of, exact = ViewsFile.load(pictures / 'views.yaml'), read_source(capture).views
    assert of.reference == 'board'
    assert [each.file for each in of.views] == [each.name for each in exact]
    truth = Truth.load(capture / 'truth.json')
    assert not done.stderr.strip()  # no line: the focal length is right
    expected = inverse(board) @ truth.pose
    for each, view in zip(of.views, exact, strict=True):
        seen = inverse(np.reshape(each.camera_to_reference, (4, 4))) @ expected[:, 3]
        away = inverse(view.camera_to_reference) @ truth.pose[:, 3]
        assert np.linalg.norm(seen - away) < 0.003 * away[2]
        sigma = np.hypot(1e-3 * each.sigma_mm, np.deg2rad(each.sigma_deg) * away[2])
        assert 1e-5 < sigma < 5e-4
    done = pmcl('localize', pictures, '--object', capture / 'model.obj', '--json', '--table',
                0, 0, 0, 0, 0, -1, '--tilt', 0, 20, '--set', 'proposals=200,particles=64')
    found = json.loads(next(each for each in done.output.splitlines() if each[:1] == '{'))
    assert not found['lost']
    assert found['position'] == pytest.approx(expected[:3, 3], abs=0.004)


@pytest.mark.skipif(not hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector'),
                    reason='OpenCV before 4.7')
def test_an_object_is_found_in_a_ring(placed, camera, tmp_path):
    """It hides a part of the ring that it stands in."""
    capture, _, _ = placed
    truth, ring = Truth.load(capture / 'truth.json'), CharucoRing(6, 8, 0.045)
    mesh = trimesh.load_mesh(capture / 'model.obj').apply_transform(truth.pose)
    turn = Rotation.from_euler('z', 40, degrees=True)
    foot = np.array([*truth.pose[:2, 3], mesh.bounds[0, 2]])
    board = pose_of(turn, foot + turn.apply([0.01, -0.02, 0]))
    for each in read_source(capture).views:
        picture, seen = each.displayed(), inverse(each.camera_to_reference)
        around = painted(picture, ring, seen @ board, PINHOLE)
        outline = PINHOLE.project(mesh.vertices @ seen[:3, :3].T + seen[:3, 3])
        hides = cv2.fillConvexPoly(np.zeros(picture.shape[:2], np.uint8), cv2.convexHull(
            np.rint(outline).astype(np.int32)), 1)
        cv2.imwrite(str(tmp_path / each.name),
                    np.where(hides[..., None] > 0, picture, around)[..., ::-1])
    done = pmcl('board-poses', tmp_path, '--camera', camera, '--ring', '6x7', '--square', 0.045,
                status=1)
    assert done.stderr.count('.png: not enough of the ring') == 3
    assert not (tmp_path / 'views.yaml').exists()
    options = '--ring', '6x8', '--square', 0.045
    done = pmcl('board-poses', tmp_path, '--camera', camera, *options)
    assert done.stdout.count(' mm away, corners 0.') == 3
    assert not done.stderr.strip()
    where = re.search(r'^what stands in the ring: (--roi 0 0 .*)$', done.stdout, re.M)[1].split()
    done = pmcl('localize', tmp_path, '--object', capture / 'model.obj', '--json', *where, '--set',
                'proposals=200,particles=64')
    found = json.loads(next(each for each in done.output.splitlines() if each[:1] == '{'))
    assert not found['lost']
    expected = inverse(board) @ truth.pose
    assert found['position'] == pytest.approx(expected[:3, 3], abs=0.004)


@pytest.mark.parametrize(('options', 'asked'), [
    ((), 'say what the board is'),
    (('--corners', '10x7', '--ring', '8x11'), 'a board is one of the two'),
])
def test_a_board_is_a_checkerboard_or_a_ring(tmp_path, options, asked):
    done = pmcl('board', *options, '--square', 0.02, '-o', tmp_path / 'board.svg', status=2)
    assert done.output.endswith(f'Error: {asked}: --corners, as 10x7, for a checkerboard, or '
                                '--ring, as 8x11, for a ring of markers\n')
    assert not list(tmp_path.iterdir())


def test_another_zoom_is_told(placed, camera, tmp_path):
    _, pictures, _ = placed
    for each in pictures.glob('*.png'):
        shutil.copy(each, tmp_path)
    other = yaml.safe_load(camera.read_text())
    other |= {name: 0.8 * other[name] for name in ('fx', 'fy')}
    (tmp_path / 'other.yaml').write_text(yaml.safe_dump(other))
    done = pmcl('board-poses', tmp_path, '--camera', tmp_path / 'other.yaml', '--corners', '6x5',
                '--square', 0.012)
    told = r'with a focal length that is 2[3-7] % longer \(.*zoom and focus'
    assert re.search(told, done.stderr)


def test_another_principal_point_is_told(boards, camera, tmp_path):
    for number in range(3):
        shutil.copy(boards / f'{number}.png', tmp_path)
    options = '--corners', '10x7', '--square', 0.02
    assert not pmcl('board-poses', tmp_path, '--camera', camera, *options).stderr.strip()
    other = yaml.safe_load(camera.read_text())
    other |= {'cx': other['cx'] + 40, 'cy': other['cy'] - 30}
    (tmp_path / 'other.yaml').write_text(yaml.safe_dump(other))
    done = pmcl('board-poses', tmp_path, '--camera', tmp_path / 'other.yaml', *options, '--force')
    told = re.search(r'the boards fit best with a principal point that is \((-?\d+), (-?\d+)\) px '
                     'aside', done.stderr)
    assert told, done.stderr
    assert [int(each) for each in told.groups()] == pytest.approx([-40, 30], abs=5)


def test_a_list_that_is_there_is_told_with_what_force_keeps(tmp_path):
    """Its name is given: another one cannot be asked for."""
    (tmp_path / 'views.yaml').touch()
    (tmp_path / 'camera.yaml').touch()
    done = pmcl('board-poses', tmp_path, '--camera', tmp_path / 'camera.yaml', '--corners', '6x5',
                '--square', 0.012, status=1)
    assert done.stderr == (
        f'Error: {tmp_path / "views.yaml"} is there already: say --force to write it anew; what '
        'it says beside the camera and its poses, as masks, is kept\n')


def test_pictures_without_a_board_are_left_out_and_none_is_an_error(placed, camera, tmp_path):
    capture, pictures, _ = placed
    blank = cv2.imread(str(capture / '000.png'))
    cv2.imwrite(str(tmp_path / 'a.png'), blank)
    of_simulation = tmp_path / 'camera.yaml'
    values = yaml.safe_load(camera.read_text())
    del values['fy']  # it is fx then
    of_simulation.write_text(yaml.safe_dump(values | {'noise': 0.01}))
    arguments = ('board-poses', tmp_path, '--camera', of_simulation, '--corners', '6x5',
                 '--square', 0.012)
    done = pmcl(*arguments, status=1)
    assert 'a.png: no complete board' in done.stderr
    assert 'no camera pose by a board of --corners 6x5 --square 0.012 in 1 pictures' in done.stderr
    assert not (tmp_path / 'views.yaml').exists()
    (tmp_path / 'b.png').write_bytes((pictures / '000.png').read_bytes())
    other = tmp_path / os.fsdecode(b'caf\xe9.png')  # from a machine of another locale
    other.write_bytes((pictures / '000.png').read_bytes())
    done = pmcl(*arguments)
    assert 'caf\\udce9.png: its name is no UTF-8, as views.yaml has to be' in done.stderr
    before = (tmp_path / 'views.yaml').read_text()
    assert [each['file'] for each in yaml.safe_load(before)['views']] == ['b.png']
    done = pmcl(*arguments, status=1)
    assert '--force' in done.stderr
    assert (tmp_path / 'views.yaml').read_text() == before

    # What somebody added is kept with --force, what the board tells is written anew.
    written = yaml.safe_load(before)
    mine = yaml.safe_load(before) | {'bits': 12}
    mine['cameras']['camera'] |= {'mask': 'gripper.png', 'fx': 2 * CAMERA['fx'],
                                         'fy': 2 * CAMERA['fx']}
    mine['views'] = [mine['views'][0] | {'mask': 'hand.png', 'stamp': 5.5, 'sigma_mm': 9.0},
                     {'file': 'gone.png', 'camera': 'camera', 'camera_to_reference': [
                         1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}]
    (tmp_path / 'views.yaml').write_text(yaml.safe_dump(mine))
    pmcl(*arguments, '--force')
    written['cameras']['camera']['mask'] = 'gripper.png'
    written['views'][0] |= {'mask': 'hand.png', 'stamp': 5.5}
    assert yaml.safe_load((tmp_path / 'views.yaml').read_text()) == written | {'bits': 12}
    (tmp_path / 'views.yaml').write_text(before.replace('views:', 'view:'))
    assert re.search('views.yaml: .*mend it, or remove it',
                     pmcl(*arguments, '--force', status=1).stderr)


def test_a_folder_of_other_pictures_is_refused(boards, camera, tmp_path):
    for command, more in (('calibrate-camera', ('-o', tmp_path / 'c.yaml')),
                          ('board-poses', ('--camera', camera))):
        done = pmcl(command, tmp_path, '--corners', '10x7', '--square', 0.02, *more, status=1)
        assert 'has no pictures (.png, .jpg' in done.stderr
        done = pmcl(command, camera, '--corners', '10x7', '--square', 0.02, *more, status=1)
        assert f'{camera} is a file: give the folder of the pictures' in done.stderr
    for number, size in enumerate([(300, 400), (240, 320)]):
        cv2.imwrite(str(tmp_path / f'{number}.png'), np.full(size, 90, np.uint8))
    done = pmcl('calibrate-camera', tmp_path, '--corners', '10x7', '--square', 0.02, '-o',
                tmp_path / 'c.yaml', status=1)
    assert '1.png has 320x240 px, 0.png 400x300: all must have one size' in done.stderr
    assert 'no complete board' not in done.stderr  # it is told before any is searched
    done = pmcl('calibrate-camera', boards, '--corners', '10x7', '--square', 0.02, '-o',
                tmp_path / 'c.json', status=2)
    assert 'give the name of a camera YAML' in done.stderr
    (tmp_path / '1.png').unlink()
    done = pmcl('calibrate-camera', tmp_path, '--corners', '9x8', '--square', 0.02, '-o',
                tmp_path / 'c.yaml', status=1)
    assert '0 pictures show the board; a calibration needs 5' in done.stderr
    done = pmcl('board-poses', boards, '--camera', camera, '--corners', '9x7', '--square', 0.02,
                status=1)
    assert 'looks the same upside down' in done.stderr
