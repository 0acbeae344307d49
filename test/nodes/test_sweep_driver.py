"""A sweep of an ordinary camera, replayed from a bag through real nodes, gives a pose."""

import re
from array import array
from dataclasses import replace
from importlib.util import find_spec

import cv2
import numpy as np
import pytest
import rclpy
import trimesh
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, Process
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.lightfield.readers.pictures import full_range
from pmcl_ros.lightfield.sweep.assemble import assemble
from pmcl_ros.lightfield.sweep.plan import SweepPlan
from pmcl_ros.lightfield.sweep.settings import SweepSettings
from pmcl_ros.messages import bags
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.image import picture_to_message
from pmcl_ros.messages.light_field import light_field_from
from pmcl_ros.messages.pose import pose_from, pose_to_message
from pmcl_ros.messages.posed_views import mosaic_from
from pmcl_ros.nodes.runtime.base import BIG, SMALL
from pmcl_ros.nodes.sweep_driver import SweepDriver
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene
from pmcl_ros.simulation.scenes.render import photographs, seen_from

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STEP = 0.03
NEAR, FAR = 0.3, 1.0
BASE = np.eye(4)  # of the grid's middle in the robot's base
BASE[:3, :3] = Rotation.from_euler('xyz', [170, 20, -40], degrees=True).as_matrix()
BASE[:3, 3] = 0.5, -0.2, 0.9


@pytest.fixture(scope='module')
def scene():
    settings = SceneSettings(kinds=('opaque',), empty=0, outside=0, clutter=0, size=128)
    return random_scene(np.random.default_rng(3), settings)


@pytest.fixture(scope='module')
def frames(scene):
    """Nine pictures of a hand-eye camera near the planned places, a second apart."""
    rng = np.random.default_rng(0)
    poses = []
    for each in SweepPlan.from_grid(3, 3, STEP).poses:
        pose = each.pose
        if (each.row, each.column) != (1, 1):
            pose[:3, 3] += 0.001 * rng.standard_normal(3) * [1, 1, 0.2]
            pose[:3, :3] = Rotation.from_rotvec(0.005 * rng.standard_normal(3)).as_matrix()
        poses.append(pose)
    taken = photographs(scene, poses, rng, stamp_ns=START)
    return [replace(each, pose=BASE @ each.pose) for each in taken]


def image_of(frame, frame_id='wrist_camera'):
    return picture_to_message(Header(frame.stamp_ns, frame_id), frame.image)


def info_of(frame):
    return pinhole_to_message(Header(frame.stamp_ns, 'wrist_camera'), frame.lens.pinhole)


def pose_of(stamp_ns, pose, frame_id='base_link'):
    return PoseStamped(header=header_to_message(Header(stamp_ns, frame_id)),
                       pose=pose_to_message(pose))


def record(bag, frames):
    """What a robot's bag has: poses at 20 Hz while the arm goes from stop to stop, images at
    each stop and on each way."""
    messages = []
    for each, after in zip(frames, [*frames[1:], frames[-1]], strict=True):
        messages += [(each.stamp_ns, '/camera_info', info_of(each)),
                     (each.stamp_ns, '/image', image_of(each)),
                     (each.stamp_ns + SECOND // 2, '/image',
                      image_of(replace(each, stamp_ns=each.stamp_ns + SECOND // 2)))]
        for tick in range(-2, 18):  # it stands for 0.2 s, then it moves for 0.8 s
            part = np.clip((tick - 2) / 16, 0, 1)
            pose = each.pose.copy()
            pose[:3, 3] += part * (after.position - each.position)
            messages.append((each.stamp_ns + tick * SECOND // 20, '/camera_pose', pose))
    lines = []
    for time_ns, topic, message in sorted(messages, key=lambda each: each[0]):
        if topic == '/camera_pose':
            message = pose_of(time_ns, message)
        kind = f'{type(message).__module__.split(".")[0]}/msg/{type(message).__name__}'
        lines.append(bags.Recorded(topic, kind, time_ns, serialize_message(message)))
    bags.record(bag, lines)


def test_a_sweep_from_a_bag_gives_a_pose(tmp_path, user, scene, frames):
    record(tmp_path / 'bag', frames)
    target = scene.targets[0]
    trimesh.Trimesh(target.vertices, target.faces, process=False).export(tmp_path / 'model.obj')
    SweepPlan.from_grid(3, 3, STEP, BASE, 'base_link').save(tmp_path / 'plan.yaml')
    parameters = tmp_path / 'parameters.yaml'
    parameters.write_text(yaml.safe_dump({
        'sweep_driver': {'ros__parameters': {'near': NEAR, 'far': FAR, 'poses': 'topic',
                                             'exposure': 0.1, 'movement': 1.0,
                                             'patience': 60.0,
                                             'collect': 'rest'}},  # --sweep says grid
        'dlv_node': {'ros__parameters': {'near': NEAR, 'far': FAR, 'labels': 50,
                                         'edge_labels': 40}},
        'pmcl_node': {'ros__parameters': {
            'object': str(tmp_path / 'model.obj'), 'roi_center': list(target.roi_center),
            'roi_size': list(target.roi_size), 'source': 'posed_views'}}}))
    with Process(tmp_path, 'pmcl_ros.nodes.bringup', '--params-file', parameters,
                 '--sweep', tmp_path / 'plan.yaml', '--processes') as chain:
        poses = user.listen(PoseStamped, 'pose', SMALL)
        with Process(tmp_path, 'pmcl_ros.nodes.replay', tmp_path / 'bag', '--rate', '4'):
            user.wait(lambda: poses or not chain.alive(), 'a pose')
        assert chain.alive(), chain.log
    assert 'lytro_driver' not in chain.log
    assert 'sweep: 9 of 3x3 views' in chain.log
    assert 'frame 2: moved by' in chain.log
    header, pose = pose_from(poses[0])
    # of the reference, the picture nearest to the grid's middle, in its camera's frame
    middle = next(each for each in frames if np.allclose(each.pose, BASE))
    assert header == Header(middle.stamp_ns, 'wrist_camera')
    error = pose_error(pose, target.pose, Symmetry(target.axis))
    assert error.translation < 0.01
    assert np.degrees(error.rotation) < 5 or np.degrees(error.rotation) > 175


def test_the_truth_moves_with_the_camera(scene):
    by = np.eye(4)
    by[:3, :3] = Rotation.from_euler('y', 10, degrees=True).as_matrix()
    by[:3, 3] = 0.05, -0.02, 0.01
    moved = seen_from(scene, by)
    np.testing.assert_allclose(by @ moved.targets[0].pose, scene.targets[0].pose, atol=1e-12)
    np.testing.assert_allclose(moved.world_from_camera, scene.world_from_camera @ by[:3, :3])


class Robot:
    """A camera and an arm."""

    def __init__(self, user):
        self.user = user
        self.image = user.publisher(Image, 'image', BIG)
        # Of depth 1, as then what is delivered is told at once, not by the next heartbeat (3 s).
        self.info = user.publisher(CameraInfo, 'camera_info', BIG)
        self.pose = user.publisher(PoseStamped, 'camera_pose', BIG)

    def shoot(self, frame, frame_id='wrist_camera', posed=True):
        self.image.publish(image_of(frame, frame_id))
        self.user.delivered(self.image)
        if posed:  # after its image, of its very stamp
            self.pose.publish(pose_of(frame.stamp_ns, frame.pose))
            self.user.delivered(self.pose)

    def ask(self, service):
        return self.user.call(Trigger, f'/sweep_driver/{service}', Trigger.Request())


def test_started_and_finished_by_hand_with_every_frame_accounted_for(tmp_path, user, frames):
    settings = {'poses': 'topic', 'rows': 3, 'columns': 3, 'baseline': STEP, 'near': NEAR,
                'far': FAR, 'at_once': False, 'patience': 100.0, 'gap': 2.0, 'movement': 5.0}
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params=settings) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot = Robot(user)
        views, infos, pupils, centres = (user.listen(kind, topic, qos) for kind, topic, qos in (
            (Image, 'views', BIG), (CameraInfo, 'views/camera_info', SMALL),
            (Image, 'views/pupil', SMALL), (Image, 'center/image', SMALL)))
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)

        def values(key):
            found = {each.key: each.value for each in states[-1].status[0].values}
            return found.get(key)

        refused = robot.ask('finish')
        assert not refused.success
        assert 'call ~/start' in refused.message
        robot.shoot(frames[0])
        user.wait(lambda: states and values('frames outside of sweeps') == '1', 'it to be counted')

        assert robot.ask('start').success
        robot.info.publish(info_of(frames[0]))
        user.delivered(robot.info)
        for each in frames[:-1]:
            robot.shoot(each)
        robot.shoot(frames[-1], 'other_camera', posed=False)
        user.wait(lambda: "is of 'other_camera', those before it" in node.log, 'its refusal')
        user.wait(lambda: values('views') == '8 of 9', 'eight views')
        robot.shoot(frames[-1], posed=False)
        answer = robot.ask('finish')  # one is missing, the sweep is published all the same
        assert answer.success, answer.message
        assert answer.message.startswith('8 of 3x3 views')
        assert 'frame 10: its pose had not come when the sweep ended' in answer.message
        user.wait(lambda: views and infos and pupils and centres, 'the light field')
        user.wait(lambda: values('last sweep') == answer.message, 'it to be told')
        assert values('sweep') == 'none'
        assert values('left out last').startswith('frame 10: its pose had not come')

        found = light_field_from(infos[0], pupils[0], views[0])
        of = SweepSettings(rows=3, columns=3, baseline=STEP, near=NEAR, far=FAR)
        expected = assemble(frames[:-1], of, 'wrist_camera').light_field
        assert found.header == expected.header
        assert found.grid.pinhole == expected.grid.pinhole
        np.testing.assert_allclose(found.grid.positions, expected.grid.positions, atol=1e-6)
        np.testing.assert_array_equal(found.grid.weights, expected.grid.weights)
        np.testing.assert_allclose(found.views, expected.views, atol=1e-4)
        assert found.grid.weights.sum() == 8

        # for who listens only now: the same again
        assert robot.ask('finish').message == answer.message
        user.wait(lambda: len(views) == 2, 'the same again')
        assert views[1] == views[0]

        # too few: told, and more may come
        assert robot.ask('start').message == 'collecting'
        robot.shoot(frames[0])
        user.wait(lambda: values('views') == '1 of 9', 'one view')
        assert (values('frames left out'), values('left out last')) == ('0', None)
        refused = robot.ask('finish')
        assert not refused.success
        assert 'nothing to publish of this sweep yet: of 1 frames 1 are good' in refused.message
        for each in frames[1:]:
            robot.shoot(each)
        user.wait(lambda: len(views) == 3, 'the sweep to finish as it is complete')
        assert '9 of 3x3 views' in node.log
        assert all(user.change('sweep_driver', DEACTIVATE, ACTIVATE, DEACTIVATE, CLEANUP))
        assert 'Traceback' not in node.log


def test_what_waits_in_vain_for_its_camera_info_is_told(tmp_path, user, frames):
    """Whatever becomes of the rest of the sweep."""
    settings = {'poses': 'topic', 'rows': 1, 'columns': 2, 'baseline': STEP, 'near': NEAR,
                'far': FAR, 'patience': 0.5}
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params=settings) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot = Robot(user)
        robot.shoot(frames[0])
        user.wait(lambda: re.search('dropped frame 1, .*: no camera_info has come', node.log),
                  'the first to be given up')
        refused = info_of(frames[0])
        refused.distortion_model, refused.d = 'fisheye', array('d', [0.1] * 4)
        for each in (info_of(frames[0]), refused):  # the camera was started again, say
            robot.info.publish(each)
            user.delivered(robot.info)
        robot.shoot(frames[0])
        user.wait(lambda: re.search("dropped frame 2.*model 'fisheye' is not known", node.log),
                  'the second to be given up')
        refused = robot.ask('finish')
        assert not refused.success
        assert 'frame 1: no camera_info has come' in refused.message


def test_an_image_that_waits_for_its_pose_keeps_its_own_camera_info(tmp_path, user, frames):
    """Not the one that came meanwhile, of another zoom: all views stay of one camera."""
    settings = {'poses': 'topic', 'rows': 3, 'columns': 3, 'baseline': STEP, 'near': NEAR,
                'far': FAR, 'gap': 2.0, 'movement': 5.0, 'patience': 100.0}
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params=settings) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot = Robot(user)
        infos = user.listen(CameraInfo, 'views/camera_info', SMALL)
        pinhole = frames[0].lens.pinhole
        zoomed = replace(pinhole, fx=2 * pinhole.fx, fy=2 * pinhole.fy)
        for each in frames:
            robot.info.publish(info_of(each))
            user.delivered(robot.info)
            robot.shoot(each, posed=False)
            later = Header(each.stamp_ns + SECOND // 2, 'wrist_camera')
            robot.info.publish(pinhole_to_message(later, zoomed))
            user.delivered(robot.info)
            user.state('sweep_driver')  # it has taken all that when it answers
        for each in frames:
            robot.pose.publish(pose_of(each.stamp_ns, each.pose))
            user.delivered(robot.pose)
        user.wait(lambda: infos, 'the light field')
        of = SweepSettings(rows=3, columns=3, baseline=STEP, near=NEAR, far=FAR)
        expected = assemble(frames, of, 'wrist_camera').light_field
        assert infos[0].k[0] == pytest.approx(expected.grid.pinhole.fx)


ONE_BY_ONE = {'poses': 'topic', 'collect': 'service', 'gap': 20.0, 'movement': 5.0,
              'least_views': 1, 'auto_finish': False, 'patience': 100.0}


def test_a_collection_has_nothing_of_the_one_before_it(tmp_path, user, frames):
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver',
                 params=ONE_BY_ONE | {'at_once': False}) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot = Robot(user)
        views = user.listen(Image, 'posed_views', BIG)
        robot.info.publish(info_of(frames[0]))
        user.delivered(robot.info)
        for each in ('start', 'take'):
            assert robot.ask(each).success
        robot.shoot(frames[0], posed=False)  # it waits
        assert robot.ask('take').success  # that picture does not come
        assert robot.ask('start').message == 'collecting'
        robot.pose.publish(pose_of(frames[0].stamp_ns, frames[0].pose))
        user.delivered(robot.pose)
        robot.shoot(frames[1], 'other_camera')  # nobody asked
        assert robot.ask('take').success
        robot.shoot(frames[2], 'other_camera')
        user.wait(lambda: views, 'the view')
        assert robot.ask('finish').message == '1 posed views in base_link'
        user.wait(lambda: len(views) == 2, 'the same again')
        assert all(user.change('sweep_driver', DEACTIVATE, ACTIVATE)), node.log
        assert 'no sweep is going on' in robot.ask('finish').message
    assert [each.header.stamp.sec for each in views] == [frames[2].stamp_ns // SECOND] * 2


def test_what_does_not_come_is_told_with_its_topic(tmp_path, user, frames):
    """First a picture, then its camera_info, then a pose, then one that is new enough."""
    settings = ONE_BY_ONE | {'collect': 'rest', 'patience': 0.1, 'at_once': False}
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', '--ros-args', '-r',
                 'image:=/wrist/image', '-r', 'camera_pose:=/arm/pose', params=settings) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)

        def told(text, level=DiagnosticStatus.WARN):
            return states and states[-1].status[0].level == level and (
                states[-1].status[0].message.startswith(text))

        def shoot():
            image.publish(image_of(frames[0]))
            user.delivered(image)

        def tell(publisher, message):
            publisher.publish(message)
            user.delivered(publisher)

        user.wait(lambda: len(states) > 7, 'seven seconds')  # nobody needs a picture before start
        assert {each.status[0].message for each in states} == {'active'}
        assert user.call(Trigger, '/sweep_driver/start', Trigger.Request()).success
        user.wait(lambda: told('no picture for 5 s; awaited on /wrist/image (publishers: 0)'),
                  'that no picture comes')
        image = user.publisher(Image, 'wrist/image', BIG)
        shoot()
        user.wait(lambda: told('no camera_info has come on /camera_info (publishers: 0): publish '
                               'it there, or remap the topic'), 'that the camera_info is missing')
        tell(user.publisher(CameraInfo, 'camera_info', BIG), info_of(frames[0]))
        shoot()
        user.wait(lambda: told('no pose has come on /arm/pose (publishers: 0): publish it there, '
                               'remap the topic, or choose another source (poses)'),
                  'that the pose is missing')
        pose = user.publisher(PoseStamped, 'arm/pose', BIG)
        tell(pose, pose_of(START - SECOND, frames[0].pose))
        shoot()
        user.wait(lambda: told('no pose of its time, or later, has come on /arm/pose: the newest '
                               'is 1.000 s older; do both have one clock?'), 'that it is older')
        tell(pose, pose_of(START, frames[0].pose))
        shoot()
        user.wait(lambda: told('active', DiagnosticStatus.OK), 'it to be over')
        log = node.log
    assert len(re.findall('no picture for 5 s', log)) == 1
    assert 'do the cameras run, are topics to be remapped' in log


def test_the_stamp_0_of_a_pose_or_an_image_is_no_time(tmp_path, user, frames):
    """Not even that of both; poses that came before go on to count."""
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver',
                 params=ONE_BY_ONE | {'collect': 'rest'}) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot, views = Robot(user), user.listen(Image, 'posed_views', BIG)
        robot.info.publish(info_of(frames[0]))
        robot.pose.publish(pose_of(START, frames[0].pose))
        for each in (robot.info, robot.pose):
            user.delivered(each)
        robot.shoot(replace(frames[0], stamp_ns=0))
        user.wait(lambda: 'camera_pose: camera_pose has the stamp 0, which is no time: let its '
                  'publisher stamp the poses' in node.log, 'the refusal of the pose')
        robot.shoot(frames[0], posed=False)
        user.wait(lambda: views, 'the view')
        log = node.log
    assert 'image: its stamp is 0, which is no time: let the camera driver stamp its im' in log
    assert [each.header.stamp.sec for each in views] == [START // SECOND]


def test_what_a_mask_leaves_out_is_transparent_in_the_posed_views(tmp_path, user, frames):
    mask = np.full(frames[0].image.shape[:2], 255, np.uint8)
    mask[mask.shape[0] // 2:, 10:30] = 0
    cv2.imwrite(str(tmp_path / 'gripper.png'), mask)
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver',
                 params=ONE_BY_ONE | {'mask': str(tmp_path / 'gripper.png')}) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot, views = Robot(user), user.listen(Image, 'posed_views', BIG)
        robot.info.publish(info_of(frames[0]))
        user.delivered(robot.info)
        assert robot.ask('take').success
        robot.shoot(frames[0])
        user.wait(lambda: views, 'the view')
    assert views[0].encoding == 'rgba16'
    alpha = mosaic_from(views[0])[..., 3]
    np.testing.assert_array_equal(alpha, np.where(mask, 65535, 0))


def test_a_rectified_picture_of_12_bits_is_what_is_published(tmp_path, user, frames):
    """Its camera_info tells of the lens, too, by K and D."""
    values = 16 * frames[0].image.astype(np.uint16)
    image, info = image_of(frames[0]), info_of(frames[0])
    image.encoding, image.step, image.data = 'rgb16', 2 * image.step, values.tobytes()
    info.k[[0, 4]] *= 1.1
    info.d = [-0.3, 0.1, 0.0, 0.0, 0.0]
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver',
                 params=ONE_BY_ONE | {'rectified': True, 'bits': 12}) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot = Robot(user)
        views, infos = (user.listen(kind, topic, qos) for kind, topic, qos in (
            (Image, 'posed_views', BIG), (CameraInfo, 'posed_views/camera_info', SMALL)))
        assert robot.ask('take').success
        for publisher, message in ((robot.info, info), (robot.image, image),
                                   (robot.pose, pose_of(START, frames[0].pose))):
            publisher.publish(message)
            user.delivered(publisher)
        user.wait(lambda: views and infos, 'the view')
    assert infos[0].k[0] == pytest.approx(frames[0].lens.pinhole.fx)
    np.testing.assert_array_equal(mosaic_from(views[0]), full_range(values, 12))


def test_a_picture_has_the_camera_info_of_its_stamp_or_the_last_one_before_it(tmp_path, user,
                                                                              frames):
    """Whichever came when; with a hundred others of another zoom between them."""
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params=ONE_BY_ONE) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot = Robot(user)
        infos = user.listen(CameraInfo, 'posed_views/camera_info', SMALL)
        pinhole = frames[0].lens.pinhole

        def tell(stamp_ns, zoom=1):
            robot.info.publish(pinhole_to_message(
                Header(stamp_ns, 'wrist_camera'),
                replace(pinhole, fx=zoom * pinhole.fx, fy=zoom * pinhole.fy)))
            user.delivered(robot.info)

        def take(frame, told):
            assert robot.ask('start').success
            assert robot.ask('take').success
            robot.shoot(frame, posed=False)
            told()
            robot.pose.publish(pose_of(frame.stamp_ns, frame.pose))

        first, second = frames[:2]
        tell(first.stamp_ns - SECOND)
        take(first, lambda: tell(first.stamp_ns + 1, zoom=2))
        user.wait(lambda: len(infos) == 1, 'the first view')
        for number in range(101):
            tell(second.stamp_ns - 2 - number, zoom=2)
            user.state('sweep_driver')
        take(second, lambda: tell(second.stamp_ns))
        user.wait(lambda: len(infos) == 2, 'the second view')
    assert [each.k[0] for each in infos] == pytest.approx([pinhole.fx] * 2)


def test_a_hundred_images_wait_for_their_poses(tmp_path, user, frames):
    """However long its patience: more would fill the memory."""
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver',
                 params=ONE_BY_ONE | {'collect': 'rest'}) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot = Robot(user)
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)

        def dropped():
            return states and next(int(each.value) for each in states[-1].status[0].values
                                   if each.key == 'dropped')

        for number in range(102):
            robot.shoot(replace(frames[0], stamp_ns=START + number), posed=False)
            if number % 5 == 0:  # its history has room for ten
                user.state('sweep_driver')  # it has taken the images when it answers
        user.wait(lambda: dropped() == 2, 'the first to be given up')
        answer = robot.ask('finish')
        user.wait(lambda: dropped() == 102, 'the others to be given up')
        log = node.log
    assert not answer.success
    # One line in ten seconds for each reason, however many frames there are.
    assert 'dropped frame 1, ' in log
    assert 1 <= len(re.findall('dropped frame .*: 100 younger ones wait too', log)) <= 2
    assert len(re.findall('dropped frame .*: its pose had not come when the sweep', log)) == 1


def test_an_image_on_the_way_or_between_poses_far_apart_is_left_out(tmp_path, user, frames):
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver',
                 params=ONE_BY_ONE | {'collect': 'rest', 'gap': 2.0}) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        robot, pose = Robot(user), BASE.copy()
        robot.info.publish(info_of(frames[0]))
        user.delivered(robot.info)
        for at, x, turn in ((0, 0.0, 0.0), (1, 0.4, 0.2), (4, 0.4, 0.2)):  # [s], [m], [rad]
            pose[0, 3] = x
            pose[:3, :3] = Rotation.from_rotvec([turn, 0, 0]).as_matrix()
            robot.pose.publish(pose_of(START + at * SECOND, pose))
            user.delivered(robot.pose)
        for after in (SECOND // 2, 2 * SECOND):
            robot.shoot(replace(frames[0], stamp_ns=START + after), posed=False)
        user.wait(lambda: 'dropped frame 2, ' in node.log, 'the second to be given up')
        said = robot.ask('finish').message
    assert re.search(r'frame 1: moved by .* \(0\.400 m/s, 0\.200 rad/s\)', said), said
    assert '2 s are allowed (gap)' in said


def test_compressed_pictures_are_taken_from_the_topic_beside_a_remapped_one(tmp_path, user,
                                                                            frames):
    settings = {'poses': 'topic', 'rows': 3, 'columns': 3, 'baseline': STEP, 'near': NEAR,
                'far': FAR, 'gap': 2.0, 'movement': 5.0, 'patience': 60.0, 'compressed': True}
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', '--ros-args', '-r',
                 'image:=/wrist/image_raw', params=settings) as node:
        assert all(user.change('sweep_driver', CONFIGURE, ACTIVATE)), node.log
        image = user.publisher(CompressedImage, '/wrist/image_raw/compressed', BIG)
        info, pose = (user.publisher(kind, topic, BIG) for kind, topic in (
            (CameraInfo, 'camera_info'), (PoseStamped, 'camera_pose')))
        views = user.listen(Image, 'views', BIG)
        infos, pupils = (user.listen(kind, topic, SMALL) for kind, topic in (
            (CameraInfo, 'views/camera_info'), (Image, 'views/pupil')))
        for each in frames:
            data = cv2.imencode('.png', each.image[..., ::-1])[1].tobytes()
            header = header_to_message(Header(each.stamp_ns, 'wrist_camera'))
            for publisher, message in (
                    (info, info_of(each)), (pose, pose_of(each.stamp_ns, each.pose)),
                    (image, CompressedImage(header=header, format='rgb8; png compressed bgr8',
                                            data=data))):
                publisher.publish(message)
                user.delivered(publisher)
        user.wait(lambda: views and infos and pupils, 'the light field')
    of = SweepSettings(rows=3, columns=3, baseline=STEP, near=NEAR, far=FAR)
    expected = assemble(frames, of, 'wrist_camera').light_field
    found = light_field_from(infos[0], pupils[0], views[0])
    np.testing.assert_allclose(found.views, expected.views, atol=1e-4)


def test_what_cannot_be_used_is_told_and_can_be_mended(tmp_path, user):
    plan, black = tmp_path / 'plan.yaml', tmp_path / 'black.png'
    cv2.imwrite(str(black), np.zeros((48, 64), np.uint8))
    SweepPlan.from_grid(2, 2, 0.01, BASE, 'base_link').save(plan)
    views = tmp_path / 'views.yaml'
    views.write_text(yaml.safe_dump({'frame': 'base_link', 'poses': [BASE.ravel().tolist()]}))
    wrong = [({'near': 2.0}, {'near': 0.3}, 'near 2.0 m must be smaller'),
             ({'plan': '/nowhere.yaml'}, {'plan': ''}, 'there is no /nowhere.yaml'),
             ({'mask': '/nowhere.png'}, {'mask': ''}, 'there is no /nowhere.png'),
             ({'mask': str(black)}, {'mask': ''}, 'the mask is black everywhere'),
             ({'collect': 'plan'}, {}, 'collect is plan, and plan is empty: set it to'),
             ({'plan': str(views), 'fixed_frame': 'map'}, {'collect': 'grid'},
              "views.yaml is in frame 'base_link', the poses are in fixed_frame 'map'"),
             ({'plan': str(plan)}, {'fixed_frame': 'base_link'},
              "is in frame 'base_link', the poses are in fixed_frame 'map'")]
    if find_spec('tf2_ros') is None:
        wrong.append(({'poses': 'tf'}, {'poses': 'auto'}, 'tf2_ros cannot be imported'))
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver') as node:
        for bad, good, reason in wrong:
            assert user.set('sweep_driver', **bad) == []
            assert not user.change('sweep_driver', CONFIGURE)
            assert reason in node.log
            assert user.set('sweep_driver', **good) == []
        assert user.change('sweep_driver', CONFIGURE), node.log
        assert 'a sweep is 2x2 views, 0.01 m apart, at the planned poses' in node.log
        for collect in ('rest', 'service'):  # they follow no plan
            assert user.change('sweep_driver', CLEANUP)
            assert user.set('sweep_driver', collect=collect, plan='/nowhere.yaml') == []
            assert user.change('sweep_driver', CONFIGURE), node.log
        assert 'at each call of ~/take' in node.log


def test_the_log_says_which_mount_places_the_camera(tmp_path, user):
    with Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params={'poses': 'topic'}) as node:
        assert user.change('sweep_driver', CONFIGURE), node.log
        assert ("the poses count as those of the camera's optical frame: mount_position and "
                'mount_rpy are 0') in node.log
        for parent, told in (('', 'the frame whose poses camera_pose has'), ('tool0', 'tool0')):
            assert user.change('sweep_driver', CLEANUP)
            assert user.set('sweep_driver', mount_position=[0.0, -0.05, 0.1],
                            mount_rpy=[0.0, 0.0, 1.5708], mount_parent=parent) == []
            assert user.change('sweep_driver', CONFIGURE), node.log
            assert ('the camera is mounted at mount_position (0, -0.05, 0.1) m, mount_rpy (0, 0, '
                    f'1.5708) rad in {told}') in node.log


def test_the_node_looks_for_poses_only_while_images_wait(user, frames):
    """At rest nothing wakes it but two timers of a second."""
    context = Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)
    node = SweepDriver(context=context, parameter_overrides=[
        Parameter(name, value=value) for name, value in {
            'poses': 'topic', 'rows': 3, 'columns': 3, 'baseline': STEP, 'near': NEAR, 'far': FAR,
            'movement': 5.0, 'patience': 60.0}.items()])
    executor.add_node(node)
    user.others.append(executor)
    try:
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS

        def running():
            return sum(not each.is_canceled() for each in node.timers)

        user.wait(lambda: running() == 2, 'the node to rest')
        robot = Robot(user)
        robot.info.publish(info_of(frames[0]))
        user.delivered(robot.info)
        robot.shoot(frames[0], posed=False)
        user.wait(lambda: running() == 3, 'an image to wait')
        robot.pose.publish(pose_of(frames[0].stamp_ns, frames[0].pose))
        user.wait(lambda: node.health.extra['views'] == '1 of 9', 'a view')
        user.wait(lambda: running() == 2, 'the node to rest again')
    finally:
        user.others.clear()
        node.close()
        executor.shutdown()
        rclpy.shutdown(context=context)
