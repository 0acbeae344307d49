"""Cameras at rest that see one board at rest: against truth, its bound, and drawn pictures."""

import re
from contextlib import suppress

import cv2
import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from painted_boards import picture_of_board
from scipy import stats
from scipy.spatial.transform import Rotation
from test_hand_eye import BOARD, read_by

from pmcl_ros.cli import main
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, local, pose_of, transform
from pmcl_ros.grasps.settings import GraspSettings
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.fixed_cameras import camera_at_board
from pmcl_ros.lightfield.fixed_cameras import FixedCameraSettings
from pmcl_ros.nodes.runtime.parameter_file import check_parameter_file
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.simulation.simulated_arm import simulated_arm

PINHOLES = {'left': Pinhole(640, 480, 600, 600, 320, 240),
            'right': Pinhole(720, 540, 640, 640, 352, 274)}
NOISE = 0.2  # px


def board_at(distance, *rpy):
    """(4, 4) board to camera: its middle on the optical axis [m]; angles [degrees]."""
    pose = transform([0, 0, 0], np.deg2rad(rpy))
    return pose_of(pose[:3, :3], [0, 0, distance] - pose[:3, :3] @ BOARD.points.mean(axis=0))


SEEN = {'left': board_at(0.5, 25, -15, 10), 'right': board_at(0.6, -20, 30, 170)}


def corners(pose, pinhole, rng, count, hidden=0, noise=NOISE):
    """By name, corners [px] of a board in so many pictures; hidden: of them, NaN, in each."""
    exact = pinhole.project(BOARD.points @ pose[:3, :3].T + pose[:3, 3])
    pictures = {f'{number}.png': exact + rng.normal(0, noise, exact.shape)
                for number in range(count)}
    for each in pictures.values() if hidden else ():
        each[rng.permutation(len(each))[:hidden]] = np.nan
    return pictures


@pytest.mark.parametrize(('count', 'hidden'), [(1, 0), (4, 0), (1, 40), (3, 50)])
@pytest.mark.parametrize('name', PINHOLES)
def test_errors_are_those_that_are_told(name, count, hidden):
    trials, pose, rng = 200, SEEN[name], np.random.default_rng(3)
    truth, total, sizes = inverse(pose), 0.0, []
    for _ in range(trials):
        found = camera_at_board(corners(pose, PINHOLES[name], rng, count, hidden), BOARD.points,
                                PINHOLES[name])
        off = local(found.camera[None], truth)[0]
        total += off @ np.linalg.solve(found.covariance, off)
        sizes.append(found.pixels)
        assert len(found.pixels) == count
    # The variance of the corners is estimated: Fisher's distribution, which is chi-squared nearly.
    low, high = stats.chi2.ppf([0.001, 0.999], 6 * trials)
    assert low < total < high * 1.05
    free = 1 - 6 / (2 * (len(BOARD.points) - hidden) * count)  # the fit takes six of them
    assert np.mean(np.square(sizes)) == pytest.approx(2 * NOISE ** 2 * free, rel=0.02)


@pytest.mark.parametrize(('shown', 'noise'), [(8, 0.06), (8, 0.3), (14, 0.03), (14, 0.3)])
def test_few_corners_are_as_sure_as_they_are(shown, noise):
    """Their noise is hardly told by them: where they fit by chance, the pose is not surer."""
    trials, rng, squares = 400, np.random.default_rng(10), []
    pinhole, truth = PINHOLES['left'], inverse(SEEN['left'])
    for _ in range(trials):
        seen = corners(SEEN['left'], pinhole, rng, 1, noise=noise)
        order = rng.permutation(len(BOARD.points))
        seen['0.png'][order[shown:]] = np.nan
        with suppress(LightFieldError):  # a few fit as well tilted the other way
            found = camera_at_board(seen, BOARD.points, pinhole)
            off = local(found.camera[None], truth)[0]
            squares.append(off @ np.linalg.solve(found.covariance, off))
    assert len(squares) > 0.8 * trials
    # Of 400, shares have a standard deviation of 0.015.
    assert 0.85 < np.mean(np.array(squares) < stats.chi2.ppf(0.9, 6)) < 0.985
    assert np.mean(np.array(squares) < stats.chi2.ppf(0.99, 6)) > 0.94


def test_more_pictures_are_surer():
    rng, pinhole = np.random.default_rng(5), PINHOLES['left']
    one, nine = (camera_at_board(corners(SEEN['left'], pinhole, rng, count), BOARD.points, pinhole)
                 for count in (1, 9))
    ratio = np.sqrt(np.diag(one.covariance) / np.diag(nine.covariance))
    assert ratio == pytest.approx(np.full(6, 3), rel=0.3)


@pytest.mark.parametrize('name', PINHOLES)
def test_exact_corners_give_the_camera_as_sure_as_the_best_detector_s(name):
    pinhole, truth = PINHOLES[name], inverse(SEEN[name])
    exact = pinhole.project(BOARD.points @ SEEN[name][:3, :3].T + SEEN[name][:3, 3])
    found = camera_at_board({'0.png': exact}, BOARD.points, pinhole)
    np.testing.assert_allclose(found.camera, truth, atol=1e-6)
    assert found.pixels == pytest.approx([0], abs=1e-4)
    noisy = camera_at_board(corners(SEEN[name], pinhole, np.random.default_rng(4), 30),
                            BOARD.points, pinhole)
    ratio = np.diag(noisy.covariance) / np.diag(found.covariance)
    assert ratio == pytest.approx(np.full(6, (NOISE / 0.01) ** 2 / 30), rel=0.1)


def test_a_board_that_may_be_tilted_either_way_is_refused():
    rng, pinhole = np.random.default_rng(6), PINHOLES['left']
    seen = corners(board_at(4.0, 8, 0, 0), pinhole, rng, 1)
    with pytest.raises(LightFieldError, match='fits nearly as well tilted the other way'):
        camera_at_board(seen, BOARD.points, pinhole)


@pytest.mark.parametrize('beside', [0, 1])
def test_corners_on_a_line_and_one_beside_it_tell_no_pose(beside):
    seen = corners(SEEN['left'], PINHOLES['left'], np.random.default_rng(8), 1)
    seen['0.png'][BOARD.columns + beside:] = np.nan
    with pytest.raises(LightFieldError, match=r'0.png: the corners .* nearly on one line'):
        camera_at_board(seen, BOARD.points, PINHOLES['left'])


def test_a_picture_without_a_corner_is_named():
    seen = corners(SEEN['left'], PINHOLES['left'], np.random.default_rng(8), 3)
    seen['1.png'][:] = np.nan
    with pytest.raises(LightFieldError, match=r'^1\.png shows no corner of the board$'):
        camera_at_board(seen, BOARD.points, PINHOLES['left'])


def test_a_board_that_moved_is_refused():
    rng, pinhole = np.random.default_rng(7), PINHOLES['left']
    seen = corners(SEEN['left'], pinhole, rng, 9)
    seen['7.png'] = seen['7.png'] + 5
    with pytest.raises(LightFieldError, match=r'^7\.png: the corners are [56]\.\d px off: did bo'):
        camera_at_board(seen, BOARD.points, pinhole)


def photographed(folder, board, poses, hides=0):
    """A folder of pictures of a board by two cameras; hides: so many px in the middle."""
    views = []
    for name, pose in poses.items():
        for number in range(2):
            file = f'{name}{number}.png'
            noise = np.random.default_rng(number).normal(0, 2, (PINHOLES[name].height,
                                                                PINHOLES[name].width))
            picture = picture_of_board(board, pose, PINHOLES[name]) + noise
            if hides:
                x, y = np.rint(PINHOLES[name].project(pose[:3, 3])).astype(int)
                picture[y - hides:y + hides // 4, x - hides // 4:x + hides // 4] = 90
            cv2.imwrite(str(folder / file), np.clip(picture, 0, 255).astype(np.uint8))
            views.append({'file': file, 'camera': name})
    cameras = {name: {'fx': each.fx, 'cx': each.cx, 'cy': each.cy, 'width': each.width,
                      'height': each.height} for name, each in PINHOLES.items()}
    (folder / 'views.yaml').write_text(yaml.safe_dump({'cameras': cameras, 'views': views}))
    return folder


@pytest.fixture(scope='module')
def taken(tmp_path_factory):
    return photographed(tmp_path_factory.mktemp('board'), BOARD, SEEN)


def handeye(*arguments, square=0.02):
    return CliRunner().invoke(main, ['handeye', *map(str, arguments), '--square', str(square)])


def test_the_command_writes_what_fixed_cameras_takes(taken, tmp_path):
    check_cameras(taken, tmp_path, SEEN)


@pytest.mark.skipif(not hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector'),
                    reason='OpenCV before 4.7')
def test_fixed_cameras_may_see_a_ring_that_something_hides_in_part(tmp_path):
    ring = CharucoRing(6, 8, 0.03)
    poses = {name: pose_of(turn, [0.01, 0, 0.5]) for name, turn in (
        ('left', Rotation.from_euler('xz', [150, 20], degrees=True)),
        ('right', Rotation.from_euler('xyz', [-150, 5, 170], degrees=True)))}
    folder = photographed(tmp_path, ring, poses, hides=200)
    whole = ring.seen(cv2.imread(str(folder / 'left0.png'), cv2.IMREAD_GRAYSCALE))
    assert 8 < np.isfinite(whole[:, 0]).sum() < len(ring.points)
    check_cameras(folder, tmp_path, poses, '--ring', '6x8', square=0.03)
    result = handeye(folder, '--no-robot', '--ring', '6x8', '--corners', '10x7')
    assert '--ring is in place of --corners: leave out --corners' in result.output
    result = CliRunner().invoke(main, ['handeye', str(folder), '--no-robot', '--ring', '6x8'])
    assert 'say --square, the side of the squares of the ring' in result.output


def check_cameras(taken, folder, poses, *more, square=0.02):
    """The command places the cameras, and tells the right errors."""
    out = folder / 'cameras.yaml'
    result = handeye(taken, '--no-robot', '-o', out, *more, square=square)
    assert result.exit_code == 0, result.output
    assert result.output.count('.png: corners 0.') == 4
    assert result.output.count('camera in board: ') == 2
    assert check_parameter_file(out) == []
    written = yaml.safe_load(out.read_text())
    settings = FixedCameraSettings.make(written['/**/fixed_cameras']['ros__parameters'])
    assert settings.cameras == ('left', 'right')
    assert settings.fixed_frame == 'board'
    mounts = np.reshape(settings.camera_mounts, (2, 6))
    for mount, pose in zip(mounts, poses.values(), strict=True):
        off = local(transform(mount[:3], mount[3:])[None], inverse(pose))[0]
        assert (abs(off[:3]) < 4 * settings.sigma_position).all()
        assert (abs(off[3:]) < 4 * settings.sigma_rotation).all()
    assert settings.sigma_position < 1e-3


def changed(taken, folder, change):
    """The folder with another views.yaml."""
    values = yaml.safe_load((taken / 'views.yaml').read_text())
    for each in values['views']:
        each['file'] = str(taken / each['file'])
    change(values['views'])
    (folder / 'views.yaml').write_text(yaml.safe_dump(values))
    return folder


def test_what_cannot_be_is_refused_in_one_line(taken, tmp_path):
    def blank(views):
        for number in (2, 3):
            views[number]['file'] = str(tmp_path / f'blank{number}.png')
            cv2.imwrite(views[number]['file'], np.full((540, 720), 90 + number, np.uint8))

    cases = [
        (lambda views: views.__delitem__(slice(2, None)), (), 'has pictures of left alone'),
        (blank, (), r'no board of --corners 10x7 .* of right \(.*blank2'),
        (lambda _: None, ('--corners', '9x8'), r'no board of --corners 9x8 .* of left'),
        (lambda _: None, ('--corners', '9x7'), 'looks the same upside down'),
        (lambda views: views[1].update(camera='top'), (), "is of the camera 'top', cameras has"),
        (lambda views: views[1].update(mount_to_base=np.eye(4).ravel().tolist()), (),
         'has mount_to_base, a pose of an arm: say --fixed-camera'),
        (lambda _: None, ('--fixed-camera',), 'leave out --fixed-camera')]
    for change, more, reason in cases:
        result = handeye(changed(taken, tmp_path, change), '--no-robot', *more)
        assert result.exit_code != 0
        told = [each for each in result.output.splitlines() if 'no complete board' not in each
                or 'inner corners' in each]
        assert len([each for each in told if 'rror' in each]) == 1, result.output
        assert re.search(reason, result.output.replace('\n', ' ')), result.output


def beside_an_arm(folder, *names, light_fields=False):
    """Cameras at rest and what they see of a board on an arm; writes pictures and views.yaml.

    light_fields: in place of pictures.
    """
    rng = np.random.default_rng(8)
    arms = {name: simulated_arm(rng, count=12, sigma=(2e-4, 5e-4), corners=0,
                                fixed_camera=True)
            for name in names}
    views, cameras = [], {}
    for name, arm in arms.items():
        pinhole = arm.pinhole
        values = {'fx': pinhole.fx, 'cx': pinhole.cx, 'cy': pinhole.cy}
        cameras[name] = values | {'width': 640, 'height': 480}
        for each in arm.pictures:
            picture = picture_of_board(BOARD, _board_to_camera(each.corners, arm), pinhole)
            view = {'mount_to_base': each.mount_to_base.ravel().tolist()}
            if light_fields:
                view['file'] = f'{each.name}.npz'
                light = np.float32(picture / 255) ** 2.2
                np.savez(folder / view['file'], baseline=0.001, fy=pinhole.fy, **values,
                         views=np.repeat(light[None, None, ..., None], 3, axis=-1).repeat(2, 1))
            else:
                view |= {'file': f'{name}{each.name}.png', 'camera': name}
                cv2.imwrite(str(folder / view['file']), picture)
            views.append(view)
    (folder / 'views.yaml').write_text(yaml.safe_dump({'cameras': cameras, 'views': views}))
    return arms


def check_placed(settings, arms):
    """fixed_cameras puts the cameras where they are, within the errors that it is told."""
    assert settings.cameras == tuple(arms)
    assert 'fixed_frame' not in settings.model_fields_set  # the user knows the base's name
    mounts = np.reshape(settings.camera_mounts, (-1, 6))
    for mount, arm in zip(mounts, arms.values(), strict=True):
        off = local(transform(mount[:3], mount[3:])[None], arm.camera)[0]
        assert (abs(off[:3]) < 4 * settings.sigma_position).all()
        assert (abs(off[3:]) < 4 * settings.sigma_rotation).all()


def test_several_cameras_beside_an_arm_are_written_too(tmp_path):
    arms = beside_an_arm(tmp_path, 'left', 'right')
    out = tmp_path / 'cameras.yaml'
    result = handeye(tmp_path, '--fixed-camera', '-o', out)
    assert result.exit_code == 0, result.output
    written = yaml.safe_load(out.read_text())
    assert list(written) == ['/**/fixed_cameras']
    check_placed(FixedCameraSettings.make(written['/**/fixed_cameras']['ros__parameters']), arms)


@pytest.mark.parametrize('light_fields', [False, True], ids=['pictures', 'light fields'])
def test_one_camera_beside_an_arm_is_written_as_one_at_rest(tmp_path, light_fields):
    arms = beside_an_arm(tmp_path, 'side', light_fields=light_fields)
    out = tmp_path / 'camera.yaml'
    result = handeye(tmp_path, '--fixed-camera', '-o', out)
    assert result.exit_code == 0, result.output
    assert check_parameter_file(out) == []
    assert read_by('sweep_driver', '', out) == {}  # it takes no camera at rest
    of_views = read_by('fixed_cameras', 'cell', out)
    if light_fields:
        assert of_views == {}  # it takes pictures
    else:
        check_placed(FixedCameraSettings.make(of_views), arms)
    of_grasps = read_by('grasp_node', 'cell', out)
    assert list(of_grasps) == ['arm', 'mount_position', 'mount_rpy']
    settings = GraspSettings.make(of_grasps)
    assert settings.arm == 'fixed'  # else the camera would be on mount_parent, the wrist
    off = local(transform(settings.mount_position, settings.mount_rpy)[None],
                arms['side'].camera)[0]
    assert np.linalg.norm(off[:3]) < 1e-3
    assert np.linalg.norm(off[3:]) < np.deg2rad(0.15)


def _board_to_camera(seen, arm):
    _, turn, place = cv2.solvePnP(arm.board, seen, arm.pinhole.matrix, np.zeros(4))
    return pose_of(cv2.Rodrigues(turn)[0], place.ravel())


@pytest.mark.parametrize('distance', [0.4, 1.0])
def test_what_is_beside_the_board_is_seen_as_far_off_as_told(distance):
    rng, pinhole, pose = np.random.default_rng(9), PINHOLES['left'], board_at(distance, 25, -20, 5)
    middle, reach = BOARD.points.mean(axis=0), np.ptp(BOARD.points, axis=0).max()
    directions = rng.normal(size=(100, 3))
    places = middle + reach * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    truth = places @ pose[:3, :3].T + pose[:3, 3]  # in the camera's frame
    off, told = [], []
    for _ in range(300):
        found = camera_at_board(corners(pose, pinhole, rng, 1), BOARD.points, pinhole)
        back = inverse(found.camera)
        off.append(places @ back[:3, :3].T + back[:3, 3] - truth)
        position, rotation = found.sigma_beside(BOARD.points)
        away = np.linalg.norm(found.camera[:3, 3] - middle)
        assert rotation == pytest.approx(position / away)
        told.append(position ** 2 + (rotation * away) ** 2)  # seen at that distance
        # Far less than the errors of the camera's own place.
        assert position < 0.5 * np.sqrt(np.diag(found.covariance)[:3].max())
    assert np.mean(told) == pytest.approx(np.square(off).mean(), rel=0.15)
