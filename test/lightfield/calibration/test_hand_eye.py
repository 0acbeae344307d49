"""The hand-eye calibration: against simulated arms, its bound, and pictures of a board."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
import rclpy
import yaml
from click.testing import CliRunner
from painted_boards import picture_of_board
from rclpy.context import Context
from rclpy.node import Node
from scipy import stats
from scipy.spatial.transform import Rotation

from pmcl_ros.cli import main
from pmcl_ros.cli.cameras.hand_eye import calibrated, camera_errors
from pmcl_ros.geometry.se3 import inverse, local, pose_of, retract, transform
from pmcl_ros.lightfield.calibration.arm_motions import park_martin
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.hand_eye import BoardPicture, hand_eye
from pmcl_ros.lightfield.readers import posed_views
from pmcl_ros.messages.bag_views import BagViews
from pmcl_ros.nodes.runtime.parameter_file import check_parameter_file
from pmcl_ros.runtime.errors import LightFieldError, SettingsError
from pmcl_ros.simulation.simulated_arm import simulated_arm

BOARD = Checkerboard(10, 7, 0.02)


@pytest.mark.parametrize('fixed', [False, True], ids=['on the arm', 'beside it'])
def test_errors_are_those_that_are_told_and_near_the_bound(fixed):
    squares, fitted, closed, sigmas, bounds = [], [], [], [], []
    for seed in range(12):
        arm = simulated_arm(np.random.default_rng(1000 + seed), fixed_camera=fixed)
        found = hand_eye(arm.pictures, arm.board, arm.pinhole, None, fixed)
        off = local(arm.camera[None], found.camera)[0]
        squares.append(off @ np.linalg.solve(found.covariance, off))
        fitted.append(np.linalg.norm(off[:3]))
        closed.append(np.linalg.norm(local(arm.camera[None], found.closed_form)[0, :3]))
        sigmas.append(found.sigma)
        known = hand_eye(arm.pictures, arm.board, arm.pinhole, arm.sigma, fixed).covariance
        bounds.append(np.sqrt(np.trace(known[:3, :3])))
        assert not found.left_out
    # Of 6 degrees of freedom each: the mean of 12 is 6 with a standard deviation of 1.
    assert 4 < np.mean(squares) < 9
    np.testing.assert_allclose(np.median(sigmas, axis=0), [5e-4, np.deg2rad(0.1)], rtol=0.15)
    assert np.sqrt(np.mean(np.square(fitted))) < 1.3 * np.sqrt(np.mean(np.square(bounds)))
    assert np.median(fitted) <= np.median(closed)


@pytest.mark.parametrize('hidden', [0, 40])
def test_where_only_corners_have_errors_these_are_what_is_told(hidden):
    squares, sure = [], (1e-6, 1e-6)
    for seed in range(16):
        arm = simulated_arm(np.random.default_rng(seed), sigma=sure, corners=0.3)
        for number, each in enumerate(arm.pictures):
            order = np.random.default_rng(number).permutation(len(each.corners))
            each.corners[order[:hidden]] = np.nan
        found = hand_eye(arm.pictures, arm.board, arm.pinhole, sure)
        off = local(arm.camera[None], found.camera)[0]
        squares.append(off @ np.linalg.solve(found.covariance, off))
    # Of 6 degrees of freedom each: the mean of 16 is 6 with a standard deviation of 0.9.
    assert 4 < np.mean(squares) < 8


def test_without_errors_it_is_exact_and_so_is_the_closed_form():
    arm = simulated_arm(np.random.default_rng(3), sigma=(1e-7, 1e-7), corners=1e-5)
    found = hand_eye(arm.pictures, arm.board, arm.pinhole)
    for pose in (found.camera, found.closed_form):
        np.testing.assert_allclose(pose, arm.camera, atol=2e-6)
    base = arm.pictures[0].mount_to_base @ arm.camera
    again = np.linalg.inv(base) @ found.board
    seen = arm.pinhole.project(arm.board @ again[:3, :3].T + again[:3, 3])
    np.testing.assert_allclose(seen, arm.pictures[0].corners, atol=0.01)


@pytest.mark.skipif(not hasattr(cv2, 'calibrateHandEye'),
                    reason='this OpenCV has no hand-eye calibration in Python')
def test_the_closed_form_is_opencv_s():
    arm = simulated_arm(np.random.default_rng(4))
    mounts = np.array([each.mount_to_base for each in arm.pictures])
    rng = np.random.default_rng(5)
    placed = transform([0.4, 0.1, 0.2], [1, 2, 3])
    seen = retract(inverse(arm.camera) @ inverse(mounts) @ placed,
                   1e-3 * rng.normal(size=(len(mounts), 6)))
    turn, place = cv2.calibrateHandEye(
        [*mounts[:, :3, :3]], [*mounts[:, :3, 3]], [*seen[:, :3, :3]], [*seen[:, :3, 3]],
        method=cv2.CALIB_HAND_EYE_PARK)
    found = park_martin(mounts, seen)
    np.testing.assert_allclose(found[:3, :3], turn, atol=1e-6)
    np.testing.assert_allclose(found[:3, 3], place.ravel(), atol=1e-6)


@pytest.mark.parametrize('more', [[], ['--fixed-camera']], ids=['on the arm', 'beside it'])
def test_errors_of_opencv_s_methods_stand_beside_those_of_the_fit(more):
    """Where OpenCV has them. Its method of Park and Martin is the closed form."""
    told = CliRunner().invoke(main, ['handeye', '--simulate', '2', *more])
    assert told.exit_code == 0, told.output
    medians = {name: np.array([mm, degrees], float) for name, mm, degrees in re.findall(
        r'^(.+): median (\S+) mm, (\S+) degrees$', told.output, re.MULTILINE)}
    of_opencv = [each for each in medians if each.startswith('OpenCV')]
    assert len(of_opencv) == (5 if hasattr(cv2, 'calibrateHandEye') else 0)
    assert [*medians] == ['fitted', 'closed form', *of_opencv, 'Cramer-Rao bound']
    if of_opencv:
        np.testing.assert_allclose(medians['OpenCV, Park'], medians['closed form'], atol=2e-3)


@pytest.mark.parametrize('fixed', [False, True], ids=['on the arm', 'beside it'])
def test_a_picture_that_does_not_fit_is_named_and_left_out(fixed):
    arm = simulated_arm(np.random.default_rng(6), fixed_camera=fixed)
    bad = replace(arm.pictures[7], mount_to_base=retract(
        arm.pictures[7].mount_to_base[None], np.array([[0.02, 0, 0, 0, 0.03, 0]]))[0])
    pictures = (*arm.pictures[:7], bad, *arm.pictures[8:])
    found = hand_eye(pictures, arm.board, arm.pinhole, arm.sigma, fixed)
    assert found.left_out == ('007',)
    assert found.left_pixels == pytest.approx(np.median(found.pixels), rel=0.5)
    told = local((inverse(arm.pictures[7].mount_to_base) @ bad.mount_to_base)[None], np.eye(4))
    off = found.left_motions - told
    assert np.linalg.norm(off[0, :3]) < 0.005
    assert np.linalg.norm(off[0, 3:]) < 0.01
    assert '007' not in found.names
    off = local(arm.camera[None], found.camera)[0]
    assert np.linalg.norm(off[:3]) < 0.003


def with_moved_arm(arm, rng, count):
    """The pictures, `count` of them with the arm 50 mm and 5 degrees elsewhere; their names."""
    wrong = rng.choice(len(arm.pictures), count, replace=False)
    pictures = [*arm.pictures]
    for number in wrong:
        ways = rng.normal(size=(2, 3))
        step = (ways / np.linalg.norm(ways, axis=1, keepdims=True)
                * [[0.05], [np.deg2rad(5)]]).reshape(1, 6)
        pictures[number] = replace(pictures[number], mount_to_base=retract(
            pictures[number].mount_to_base[None], step)[0])
    return pictures, {pictures[each].name for each in wrong}


@pytest.mark.parametrize('told', [False, True], ids=['estimated', 'told'])
@pytest.mark.parametrize(('count', 'wrong'), [(12, 2), (12, 3), (20, 3)])
def test_several_wrong_pictures_do_not_hide_each_other(count, wrong, told):
    for seed in range(2):
        arm = simulated_arm(np.random.default_rng(seed), count)
        pictures, names = with_moved_arm(arm, np.random.default_rng(100 + seed), wrong)
        found = hand_eye(pictures, arm.board, arm.pinhole, arm.sigma if told else None)
        assert {*found.left_out} == names
        assert len(found.left_out) == wrong
        assert np.linalg.norm(local(arm.camera[None], found.camera)[0, :3]) < 0.002


def with_reversed_boards(arm, rng, count):
    """The pictures, the board upside down in `count` of them; their names."""
    wrong = rng.choice(len(arm.pictures), count, replace=False)
    pictures = [replace(each, corners=each.corners[::-1]) if number in wrong else each
                for number, each in enumerate(arm.pictures)]
    return pictures, {pictures[each].name for each in wrong}


@pytest.mark.parametrize('fixed', [False, True], ids=['on the arm', 'beside it'])
@pytest.mark.parametrize('wrong', [1, 2, 3])
def test_boards_seen_upside_down_are_left_out(wrong, fixed):
    for seed in range(4):
        arm = simulated_arm(np.random.default_rng(seed), fixed_camera=fixed)
        pictures, names = with_reversed_boards(arm, np.random.default_rng(9 + seed), wrong)
        found = hand_eye(pictures, arm.board, arm.pinhole, None, fixed)
        assert {*found.left_out} == names
        assert np.linalg.norm(local(arm.camera[None], found.camera)[0, :3]) < 0.002


@pytest.mark.parametrize('fixed', [False, True])
def test_boards_that_fit_tilted_either_way_are_resolved_by_the_others(fixed):
    """Far away, every tenth fits better tilted the wrong way; none is lost."""
    for seed in range(4):
        arm = simulated_arm(np.random.default_rng(seed), corners=0.5, fixed_camera=fixed,
                            distance=3.0)
        found = hand_eye(arm.pictures, arm.board, arm.pinhole, None, fixed)
        assert found.left_out == ()
        off = local(arm.camera[None], found.camera)[0]
        assert np.rad2deg(np.linalg.norm(off[3:])) < 1.5
        assert off @ np.linalg.solve(found.covariance, off) < stats.chi2.ppf(0.9999, 6)


def test_more_boards_upside_down_than_a_quarter_are_named_and_refused():
    arm = simulated_arm(np.random.default_rng(0))
    pictures, names = with_reversed_boards(arm, np.random.default_rng(9), 6)
    with pytest.raises(LightFieldError) as refused:
        hand_eye(pictures, arm.board, arm.pinhole)
    assert str(refused.value).startswith(
        f'in 6 of 20 pictures ({", ".join(sorted(names))}) the arm turned otherwise')


def test_no_right_picture_of_six_is_left_out():
    # By a chi-squared distribution one would be: as if the arm's errors were told.
    arm = simulated_arm(np.random.default_rng(1053), 6)
    assert hand_eye(arm.pictures, arm.board, arm.pinhole).left_out == ()


@pytest.mark.parametrize(('count', 'chance', 'left'), [
    (40, 1e-5, False), (40, 1e-7, True), (8, 1e-3, False), (8, 1e-6, True)])
def test_the_more_pictures_the_farther_off_one_of_them_may_be(count, chance, left):
    """One in ten thousand calibrations leaves a right picture out, of however many."""
    exact = simulated_arm(np.random.default_rng(2), count, (1e-7, 1e-7), 1e-3)
    told = 0.002, np.deg2rad(0.2)
    aside = np.array([[0, 0, told[0] * stats.chi2.isf(chance, 6) ** 0.5, 0, 0, 0]])
    pictures = list(exact.pictures)
    pictures[3] = replace(pictures[3], mount_to_base=retract(
        pictures[3].mount_to_base[None], aside)[0])
    found = hand_eye(pictures, exact.board, exact.pinhole, told)
    assert found.left_out == ((pictures[3].name,) if left else ())


def test_too_few_pictures_and_parallel_axes_are_refused():
    arm = simulated_arm(np.random.default_rng(7))
    with pytest.raises(LightFieldError, match=r'5 pictures with a board; .* needs 6, better 20'):
        hand_eye(arm.pictures[:5], arm.board, arm.pinhole)
    with pytest.raises(LightFieldError, match=r'^0 pictures .* 20; are the numbers of --corners'):
        hand_eye([], arm.board, arm.pinhole)
    parallel = [replace(each, mount_to_base=transform([0, 0, 0.1 * k], [0, 0, 0.2 * k]))
                for k, each in enumerate(arm.pictures)]
    with pytest.raises(LightFieldError, match='the axes are parallel; turn it by 30 degrees'):
        hand_eye(parallel, arm.board, arm.pinhole)
    skewed = replace(arm.pictures[0], mount_to_base=np.diag([1.01, 1, 1, 1]))
    with pytest.raises(LightFieldError, match=r'000: mount_to_base is no rotation: its rows'):
        hand_eye([skewed, *arm.pictures[1:]], arm.board, arm.pinhole)


@pytest.mark.parametrize('fixed', [False, True])
def test_poses_the_other_way_round_and_other_units_are_refused(fixed):
    arm = simulated_arm(np.random.default_rng(7), fixed_camera=fixed)
    inverted = [replace(each, mount_to_base=inverse(each.mount_to_base)) for each in arm.pictures]
    shuffled = [replace(each, mount_to_base=other.mount_to_base) for each, other in zip(
        arm.pictures, arm.pictures[::-1], strict=True)]
    with pytest.raises(LightFieldError, match='the arm turned otherwise than the boards'):
        hand_eye(shuffled, arm.board, arm.pinhole, None, fixed)
    for pictures, fixed_camera in ((inverted, fixed), (arm.pictures, not fixed)):
        told = 'on the arm (without' if fixed_camera else 'beside the arm (with'
        with pytest.raises(LightFieldError, match=re.escape(f'for a camera {told} --fixed')):
            hand_eye(pictures, arm.board, arm.pinhole, None, fixed_camera)
    for factor in (1000, 1.5):
        scaled = [replace(each, mount_to_base=each.mount_to_base * np.reshape(
            [1, 1, 1, factor] * 3 + [1] * 4, (4, 4))) for each in arm.pictures]
        with pytest.raises(LightFieldError, match='times as large as told') as refused:
            hand_eye(scaled, arm.board, arm.pinhole, None, fixed)
        size = str(refused.value).split()[7]
        assert float(size) == pytest.approx(factor, rel=0.05)
        assert 'e' not in size


@pytest.mark.parametrize('fixed', [False, True], ids=['on the arm', 'beside it'])
def test_few_turns_about_two_axes_tell_whether_the_camera_is_on_the_arm(fixed):
    """Most about one axis: these fit either way, and the camera was half a metre off."""
    arm = simulated_arm(np.random.default_rng(1))
    placed, pictures = transform([0.5, 0.2, 0.1], [0.1, 0.2, 0.3]), []
    rng = np.random.default_rng(2)
    for number, angles in enumerate([(-30, 0), (-15, 0), (0, 0), (15, 0), (30, 0), (30, 30),
                                     (20, -30), (30, 25)]):
        turn = Rotation.from_euler('xy', angles, degrees=True)
        seen = pose_of(turn, [0, 0, 0.5] - turn.apply(arm.board.mean(axis=0))
                       + rng.normal(0, 0.02, 3))
        mount = placed @ inverse(arm.camera @ seen)
        pictures.append(BoardPicture(
            str(number), arm.pinhole.project(arm.board @ seen[:3, :3].T + seen[:3, 3]),
            inverse(mount) if fixed else mount))
    found = hand_eye(pictures, arm.board, arm.pinhole, None, fixed)
    np.testing.assert_allclose(found.camera, arm.camera, atol=1e-6)
    with pytest.raises(LightFieldError, match='is it there, or is mount_to_base the pose of the'):
        hand_eye(pictures, arm.board, arm.pinhole, None, not fixed)


@pytest.mark.parametrize('seed', range(6))
def test_transposed_rotations_of_the_link_are_refused(seed):
    """Small turns about one pose fit their inverses by half: errors of 9 degrees, of no arm."""
    arm = simulated_arm(np.random.default_rng(seed))
    turned = [replace(each, mount_to_base=np.block([
        [each.mount_to_base[:3, :3].T, each.mount_to_base[:3, 3:]], [np.eye(4)[3:]]]))
        for each in arm.pictures]
    with pytest.raises(LightFieldError, match=r'turned otherwise than the boards|do not fit'):
        hand_eye(turned, arm.board, arm.pinhole)


@pytest.mark.parametrize('fixed', [False, True], ids=['on the arm', 'beside it'])
@pytest.mark.parametrize(('size', 'says'), [(1, None), (1.04, 'smaller'), (0.98, 'larger')])
def test_squares_of_another_side_are_told(caplog, size, says, fixed):
    arm = simulated_arm(np.random.default_rng(3), sigma=(2e-4, 5e-4), fixed_camera=fixed)
    found = hand_eye(arm.pictures, size * arm.board, arm.pinhole, None, fixed)
    off = 1e3 * np.linalg.norm(local(arm.camera[None], found.camera)[0][:3])
    if says is None:
        assert not caplog.text
        assert off < 3
    else:
        line, = caplog.messages
        told = re.search(r'is ([\d.]+) % (\w+) than told \(standard deviation ([\d.]+)\)', line)
        assert told[2] == says
        assert float(told[1]) == pytest.approx(abs(100 / size - 100), abs=3 * float(told[3]) + 0.1)
        assert off > 5


def test_one_picture_alone_may_turn_about_a_second_axis():
    arm = simulated_arm(np.random.default_rng(3))
    placed, pictures = transform([0.5, 0.2, 0.1], [0.1, 0.2, 0.3]), []
    rng = np.random.default_rng(5)
    for number, angles in enumerate([(-40, 0), (-20, 0), (0, 0), (20, 0), (40, 0), (0, 40)]):
        turn = Rotation.from_euler('xy', angles, degrees=True)
        seen = pose_of(turn, [0, 0, 0.5] - turn.apply(arm.board.mean(axis=0))
                       + rng.normal(0, 0.02, 3))
        pictures.append(BoardPicture(
            str(number), arm.pinhole.project(arm.board @ seen[:3, :3].T + seen[:3, 3]),
            placed @ inverse(arm.camera @ seen)))
    found = hand_eye(pictures, arm.board, arm.pinhole)
    np.testing.assert_allclose(found.camera, arm.camera, atol=1e-6)


def test_a_focal_length_of_another_zoom_is_told(caplog):
    arm = simulated_arm(np.random.default_rng(3))
    zoomed = replace(arm.pinhole, fx=0.95 * arm.pinhole.fx, fy=0.95 * arm.pinhole.fy)
    hand_eye(arm.pictures, arm.board, zoomed)
    assert 'larger than told' in caplog.text
    assert 'check the focal length' in caplog.text


@pytest.mark.parametrize('seed', range(4))
def test_pictures_with_late_poses_are_left_out_and_their_cause_is_not_sought(seed):
    arm = simulated_arm(np.random.default_rng(seed))
    late = [replace(each, mount_to_base=after.mount_to_base) if number < 2 else each
            for number, (each, after) in enumerate(zip(
                arm.pictures, (*arm.pictures[1:], arm.pictures[0]), strict=True))]
    found = hand_eye(late, arm.board, arm.pinhole)
    assert {'000', '001'} <= {*found.left_out}
    assert np.linalg.norm(local(arm.camera[None], found.camera)[0][:3]) < 0.003


def test_matrices_by_columns_and_an_arm_that_never_fits_are_refused():
    arm = simulated_arm(np.random.default_rng(7))
    turned = [replace(each, mount_to_base=each.mount_to_base.T) for each in arm.pictures]
    with pytest.raises(LightFieldError, match='is no pose: it is written column by column; '):
        hand_eye(turned, arm.board, arm.pinhole)
    rng = np.random.default_rng(8)
    wrong = [replace(each, mount_to_base=retract(
        each.mount_to_base[None], 0.1 * rng.normal(size=(1, 6)))[0]) if number < 8 else each
        for number, each in enumerate(arm.pictures)]
    with pytest.raises(LightFieldError, match='more than a quarter of the pictures do not fit'):
        hand_eye(wrong, arm.board, arm.pinhole, arm.sigma)


@pytest.fixture(scope='module')
def taken(tmp_path_factory):
    """A folder of pictures of a board by a camera on an arm, and where that is."""
    folder = tmp_path_factory.mktemp('boards')
    arm = simulated_arm(np.random.default_rng(8), count=12, sigma=(2e-4, 5e-4))
    pinhole, views = arm.pinhole, []
    middle = BOARD.points.mean(axis=0)
    rng = np.random.default_rng(9)
    camera, placed = arm.camera, transform([0.5, 0.2, 0.1], [0.1, 0.2, 0.3])
    for number in range(12):
        pose = np.eye(4)
        # Half of them upside down.
        turn = [*rng.uniform(-35, 35, 2), rng.uniform(-20, 20) + 180 * (number % 2)]
        pose[:3, :3] = Rotation.from_euler('xyz', turn, degrees=True).as_matrix()
        pose[:3, 3] = [0, 0, 0.5] - pose[:3, :3] @ middle
        cv2.imwrite(str(folder / f'{number}.png'), picture_of_board(BOARD, pose, pinhole))
        error = rng.normal(size=(1, 6)) * np.repeat([2e-4, 5e-4], 3)
        mount = placed @ inverse(pose) @ inverse(camera) @ retract(np.eye(4)[None], error)[0]
        views.append({'file': f'{number}.png', 'camera': 'c',
                      'mount_to_base': mount.ravel().tolist()})
    values = {'fx': pinhole.fx, 'cx': pinhole.cx, 'cy': pinhole.cy, 'width': 640, 'height': 480}
    (folder / 'views.yaml').write_text(yaml.safe_dump({'cameras': {'c': values}, 'views': views}))
    return folder, camera


def read_by(name, namespace, *files):
    """The parameters that ROS gives a node from parameter files."""
    context = Context()
    rclpy.init(args=['--ros-args', *(part for each in files
                                     for part in ('--params-file', str(each)))], context=context)
    try:
        node = Node(name, namespace=namespace, context=context, start_parameter_services=False,
                    automatically_declare_parameters_from_overrides=True)
        values = {each: value.value for each, value in node.get_parameters_by_prefix('').items()
                  if each.startswith(('arm', 'camera', 'mount_', 'sigma_', 'common'))}
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)
    return dict(sorted(values.items()))


def test_the_command_finds_the_boards_and_writes_what_nodes_read(taken, tmp_path):
    folder, camera = taken
    out = tmp_path / 'made' / 'by' / 'mount.yaml'
    result = CliRunner().invoke(main, ['handeye', str(folder), '--square', '0.02', '--parent',
                                       'wrist', '-o', str(out)])
    assert result.exit_code == 0, result.output
    assert result.output.count('corners 0.') == 12
    assert check_parameter_file(out) == []
    own = tmp_path / 'mine.yaml'  # as a copy of config/pmcl.yaml has them
    own.write_text(yaml.safe_dump({f'/**/{node}': {'ros__parameters': {'sigma_position': 1.0}}
                                   for node in ('sweep_driver', 'fixed_cameras')}))
    values = read_by('sweep_driver', 'left', own, out)
    of_grasps = read_by('grasp_node', '', own, out)
    assert of_grasps == {name: each for name, each in values.items() if 'mount_' in name}
    assert list(of_grasps) == ['mount_parent', 'mount_position', 'mount_rpy']
    assert read_by('fixed_cameras', '', own, out) == {'sigma_position': 1.0}  # of other cameras
    assert values['mount_parent'] == 'wrist'
    collected = BagViews.load(out)
    assert collected.mount_parent == 'wrist'
    assert collected.mount_rpy == pytest.approx(tuple(values['mount_rpy']), rel=1e-12)
    # Stated as they are estimated, and printed.
    errors = camera_errors(calibrated(folder, BOARD, False))
    assert errors == {name: values[name] for name in ('sigma_position', 'sigma_rotation',
                                                      'common')}
    assert errors == {name: getattr(collected, name) for name in errors}
    assert (f"errors of the camera's poses on each axis: {1e3 * errors['sigma_position']:.2f} mm, "
            f"{np.rad2deg(errors['sigma_rotation']):.3f} degrees; {100 * errors['common']:.0f} % "
            'of their variance is in common') in result.output
    found = transform(values['mount_position'], values['mount_rpy'])
    off = local(camera[None], found)[0]
    assert np.linalg.norm(off[:3]) < 1e-3
    assert np.linalg.norm(off[3:]) < np.deg2rad(0.15)


def test_the_errors_of_camera_poses_are_those_that_are_stated():
    """Of simulated arms: poses that they report of their cameras are off by as much, and alike."""
    squares, alike = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        arm = simulated_arm(rng, count=12, sigma=(4e-4, 2e-3))
        found = hand_eye(arm.pictures, arm.board, arm.pinhole)
        stated = camera_errors(found)
        link = retract(np.tile(np.eye(4), (200, 1, 1)),
                       rng.normal(size=(200, 6)) * np.repeat(arm.sigma, 3))
        off = local(link @ found.camera, arm.camera) / np.repeat(
            [stated['sigma_position'], stated['sigma_rotation']], 3)
        squares.append(np.square(off).reshape(200, 2, 3).mean(axis=(0, 2)))
        alike.append([*np.square(off.mean(axis=0)).reshape(2, 3).mean(axis=1), stated['common']])
    np.testing.assert_allclose(np.mean(squares, axis=0), 1, atol=0.25)
    place, turn, common = np.mean(alike, axis=0)
    assert common == pytest.approx(max(place, turn), rel=0.4)


def test_the_residuals_of_a_picture_that_is_left_out_are_told(taken, tmp_path):
    folder, _ = taken
    values = yaml.safe_load((folder / 'views.yaml').read_text())
    for each in values['views']:
        each['file'] = str(folder / each['file'])
    values['views'][3]['mount_to_base'][3] += 0.05
    (tmp_path / 'views.yaml').write_text(yaml.safe_dump(values))
    told = CliRunner().invoke(main, ['handeye', str(tmp_path), '--square', '0.02'])
    found = re.search(r'3\.png: corners (\S+) px, arm off by (\S+) mm, \S+ degrees: left out, it '
                      'does not fit the others', told.output)
    assert float(found[1]) < 1
    assert float(found[2]) == pytest.approx(50, abs=3)


def test_a_folder_that_cannot_be_made_is_told_before_the_work(taken, tmp_path):
    (tmp_path / 'file').touch()
    told = CliRunner().invoke(main, ['handeye', str(taken[0]), '--square', '0.02', '-o',
                                     str(tmp_path / 'file' / 'mount.yaml')])
    assert told.exit_code == 1
    assert 'corners' not in told.output
    assert told.output.splitlines() == [f'Error: {tmp_path / "file"}: File exists']


def test_the_memory_for_one_picture_is_enough(taken, monkeypatch):
    folder, camera = taken
    monkeypatch.setattr(posed_views, 'MOST_BYTES', 12 * 640 * 480)
    found = calibrated(folder, BOARD, False)
    assert len(found.names) == 12
    assert np.linalg.norm(local(camera[None], found.camera)[0, :3]) < 1e-3


def test_large_pictures_can_be_shrunk(taken, monkeypatch):
    folder, camera = taken
    monkeypatch.setattr(posed_views, 'MOST_BYTES', 12 * 320 * 240)
    with pytest.raises(LightFieldError, match=r'--shrink 2'):
        calibrated(folder, BOARD, False)
    found = calibrated(folder, BOARD, False, shrink=2)
    assert len(found.names) + len(found.left_out) == 12
    assert np.linalg.norm(local(camera[None], found.camera)[0, :3]) < 1e-3
    told = CliRunner().invoke(main, ['handeye', str(folder), '--square', '0.02', '--shrink', '2'])
    assert told.output.count('corners 0.') == len(found.names) + len(found.left_out)


def test_pictures_of_two_cameras_are_refused_before_they_are_read(taken, tmp_path):
    folder, _ = taken
    values = yaml.safe_load((folder / 'views.yaml').read_text())
    values['cameras']['d'] = values['cameras']['c'] | {'fx': 500.0}
    values['views'][3]['camera'] = 'd'
    (tmp_path / 'views.yaml').write_text(yaml.safe_dump(values))
    with pytest.raises(LightFieldError, match='has pictures of 2 cameras; give those of one'):
        calibrated(tmp_path, BOARD, False)


def test_what_is_missing_is_said(taken, tmp_path):
    folder, _ = taken
    run = CliRunner().invoke
    wrong = run(main, ['handeye', str(folder), '--corners', '9x7'])
    assert isinstance(wrong.exception, SettingsError) or 'looks the same upside' in wrong.output
    values = yaml.safe_load((folder / 'views.yaml').read_text())
    del values['views'][3]['mount_to_base']
    values['views'][3]['camera_to_reference'] = np.eye(4).ravel().tolist()
    (tmp_path / 'views.yaml').write_text(yaml.safe_dump(values))
    missing = run(main, ['handeye', str(tmp_path)])
    assert missing.exit_code != 0
    assert '3.png has no mount_to_base' in missing.output
    del values['views'][3]['camera_to_reference']
    (tmp_path / 'views.yaml').write_text(yaml.safe_dump(values))
    missing = run(main, ['handeye', str(tmp_path)])
    assert '3.png has no mount_to_base, the pose of the link' in missing.output
    values = yaml.safe_load((folder / 'views.yaml').read_text())
    for number, each in enumerate(values['views']):
        each |= {'file': str(folder / each['file']), 'sigma_mm': 0.2 + (number == 3),
                 'sigma_deg': 0.05}
    (tmp_path / 'views.yaml').write_text(yaml.safe_dump(values))
    several = run(main, ['handeye', str(tmp_path), '--square', '0.02'])
    assert '0.2 mm and 0.05 degrees, 1.2 mm and 0.05 degrees' in several.output
    localised = run(main, ['localize', str(folder), '--object', str(folder / 'views.yaml'),
                           '--roi', *['0.5'] * 6])
    assert localised.exit_code != 0
    assert run(main, ['handeye']).exit_code == 2
    simulated = run(main, ['handeye', '--simulate', '2'])
    assert 'Cramer-Rao bound: median' in simulated.output
