"""Fixed cameras of different lenses give posed views of each moment, and a pose."""

import re
import sys
import time
from dataclasses import replace
from importlib.util import find_spec
from types import SimpleNamespace
from typing import ClassVar

import cv2
import numpy as np
import pytest
import rclpy
import trimesh
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseStamped, Transform, TransformStamped, Vector3
from harness import ACTIVATE, ACTIVE, CONFIGURE, DEACTIVATE, ROOT, Process
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from test_sweep_driver import BASE, SECOND, START

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.lightfield.fixed_cameras import FixedCameraSettings
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.pictures import full_range
from pmcl_ros.lightfield.sweep.frame import Lens, SweepFrame
from pmcl_ros.lightfield.sweep.view_collection import posed_view
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.header import header_from, header_to_message
from pmcl_ros.messages.image import picture_to_message
from pmcl_ros.messages.pose import pose_from, pose_to_message
from pmcl_ros.messages.posed_views import posed_views_from, posed_views_to_messages
from pmcl_ros.nodes.fixed_cameras import FixedCameras
from pmcl_ros.nodes.runtime.base import BIG, SMALL
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_picture
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene
from pmcl_ros.simulation.scenes.render import seen_from

TOPICS = ((CameraInfo, 'posed_views/camera_info', SMALL), (PoseArray, 'posed_views/poses', SMALL),
          (Image, 'posed_views/sigma', SMALL), (Image, 'posed_views', BIG))
MS = SECOND // 1000
LENSES = {'left': OrdinaryCamera(width=240, height=180, fx=225, cx=121, cy=89),
          'right': OrdinaryCamera(width=200, height=168, fx=190, cx=98, cy=85,
                                  distortion=(-0.12, 0.03, 0.001, -0.001))}


@pytest.fixture(scope='module')
def scene():
    rng = np.random.default_rng(4)
    settings = SceneSettings(kinds=('opaque',), empty=0, outside=0, views=3,
                             field=LENSES['left'].field)
    return random_scene(rng, settings, sensor=LENSES['left'].sensor(rng))


@pytest.fixture(scope='module')
def frames(scene):
    """What each camera takes of it, 4 ms one after the other, with its pose in the base frame."""
    rng = np.random.default_rng(0)
    poses = CameraPlan(arc=(2, 45)).cameras(scene)
    return {name: SweepFrame(name, START + 4 * MS * number, take_picture(
        replace(seen_from(scene, pose), sensor=camera.sensor(rng)), camera, rng, 2), camera.lens,
        BASE @ pose) for number, ((name, camera), pose) in enumerate(
            zip(LENSES.items(), poses, strict=True))}


@pytest.fixture
def settings(tmp_path, frames):
    """The parameters of fixed_cameras."""
    path = tmp_path / 'cameras.yaml'
    path.write_text(yaml.safe_dump({'frame': 'base_link', 'poses': [
        each.pose.ravel().tolist() for each in frames.values()]}))
    return {'camera_poses': str(path), 'sigma_position': 0.002, 'common': 0.25, 'patience': 60.0}


class Camera:
    """A driver."""

    kind, topic = Image, 'image_raw'

    def __init__(self, user, frame, frame_id=None):
        self.user, self.frame, self.frame_id = user, frame, frame_id or frame.name
        # Of depth 1, as then what is delivered is told at once, not by the next heartbeat (3 s).
        self.image = user.publisher(self.kind, f'{frame.name}/{self.topic}', BIG)
        self.info = user.publisher(CameraInfo, f'{frame.name}/camera_info', BIG)

    def tell(self, distortion=None):
        message = pinhole_to_message(Header(START, self.frame.name), self.frame.lens.pinhole)
        message.d = list(self.frame.lens.distortion if distortion is None else distortion)
        self.info.publish(message)
        self.user.delivered(self.info)

    def shoot(self, after=0, image=None):
        """after: [ns]."""
        image = self.frame.image if image is None else image
        header = Header(self.frame.stamp_ns + after, self.frame_id)
        message = picture_to_message(header, image.astype(np.uint8))
        if image.dtype == np.uint16:
            message.encoding, message.step = 'rgb16', 2 * message.step
            message.data = image.tobytes()
        self.image.publish(message)
        self.user.delivered(self.image)


class RectifiedCamera(Camera):
    """A driver with image_proc. Its camera_info tells of image_raw, too: K and D."""

    topic = 'image_rect'

    def tell(self):
        message = pinhole_to_message(Header(START, self.frame.name), self.frame.lens.pinhole)
        message.k[[0, 4]] *= 1.1
        message.d = [-0.3, 0.1, 0.0, 0.0, 0.0]
        self.info.publish(message)
        self.user.delivered(self.info)


class CompressedCamera(Camera):
    """A driver that offers JPEG and PNG."""

    kind, topic = CompressedImage, 'image_raw/compressed'

    def send(self, data, kind, after=0):
        """data: (n,) uint8. after: [ns]."""
        header = header_to_message(Header(self.frame.stamp_ns + after, self.frame.name))
        self.image.publish(CompressedImage(header=header, format=kind, data=data.tobytes()))
        self.user.delivered(self.image)


def published(node, user, frames, kind=Camera):
    """The messages of the views that a node makes of one picture of each camera."""
    assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
    cameras = [kind(user, each) for each in frames.values()]
    came = [user.listen(*each) for each in TOPICS]
    for each in cameras:
        each.tell()
        each.shoot()
    user.wait(lambda: all(came), 'the views')
    return [each[0] for each in came]


def shot_until(user, came, cameras, second):
    """Shoot from that second on, until `came()`; when [ns].

    Again, where a busy machine took longer from one camera to the next than the node is patient.
    """
    sets = []
    while not came():
        sets.append((second + len(sets)) * SECOND)
        for each in cameras:
            each.shoot(sets[-1])
        until = time.monotonic() + 30
        user.wait(lambda until=until: came() or time.monotonic() > until, 'a set')
    return sets


def sent_by(frames, settings, after=0):
    """Posed views of these frames, as they go over the wire."""
    pinhole = next(iter(frames.values())).lens.pinhole
    return posed_views_to_messages(PosedViews(tuple(
        posed_view(replace(each, stamp_ns=each.stamp_ns + after), pinhole,
                   FixedCameraSettings(**settings), 'base_link', 'cameras')
        for each in frames.values())))


def equal(messages, expected):
    """Whether they are the same but for the last digits of poses."""
    np.testing.assert_allclose([each.camera_to_reference for each in
                                posed_views_from(*messages).views],
                               [each.camera_to_reference for each in
                                posed_views_from(*expected).views], atol=1e-12)
    info, poses, sigma, views = messages
    return (info, sigma, views, poses.header) == (
        expected.camera_info, expected.sigma, expected.views, expected.poses.header)


def test_each_set_of_pictures_gives_posed_views_and_a_pose(tmp_path, user, scene, frames,
                                                           settings):
    def stamp_of(number):
        return frames['right'].stamp_ns + number * SECOND // 10

    target = scene.targets[0]
    trimesh.Trimesh(target.vertices, target.faces, process=False).export(tmp_path / 'model.obj')
    centre = BASE[:3, :3] @ target.roi_center + BASE[:3, 3]
    parameters = tmp_path / 'parameters.yaml'
    parameters.write_text(yaml.safe_dump({
        'fixed_cameras': {'ros__parameters': settings},
        'pmcl_node': {'ros__parameters': {
            'object': str(tmp_path / 'model.obj'), 'roi_center': centre.tolist(),
            'roi_size': [0.12, 0.12, 0.12], 'proposals': 60, 'tracking': 'constant_velocity'}}}))
    with Process(tmp_path, 'pmcl_ros.nodes.bringup', '--params-file', parameters, '--views',
                 'fixed', '--processes', '--without', 'dlv_node') as chain:
        user.wait(lambda: 'active: pmcl_node, fixed_cameras' in chain.log or not chain.alive(),
                  'the chain')
        cameras = [Camera(user, each) for each in frames.values()]
        came = [user.listen(kind, topic, qos) for kind, topic, qos in TOPICS]
        poses = user.listen(PoseStamped, 'pose', SMALL)

        def shoot(number, seconds):
            for each in cameras:
                each.shoot(number * SECOND // 10)
                each.tell()  # the first one comes after its picture
            end = time.monotonic() + seconds
            user.wait(lambda: any(header_from(each.header).stamp_ns == stamp_of(number)
                                  for each in poses) or time.monotonic() > end, 'a pose')

        # The node publishes as soon as DDS has found one subscriber, which may be this test: a set
        # before it has found pmcl_node too is not for that one.
        first = 0
        shoot(first, 60)
        if not poses:
            first = 1
            shoot(first, 250)
        shoot(first + 1, 250)
    assert [len(each) for each in came] == [first + 2] * len(TOPICS)
    for number, messages in enumerate(zip(*came, strict=True)):
        assert equal(messages, sent_by(frames, settings, number * SECOND // 10))
    headers, found = zip(*map(pose_from, poses), strict=True)
    assert headers[-2:] == tuple(Header(stamp_of(first + number), 'base_link')
                                 for number in range(2)), chain.log
    for pose in found:
        assert pose_error(pose, BASE @ target.pose, Symmetry(target.axis)).translation < 0.01
    assert 'found in capture' in chain.log  # it is tracked


def test_what_does_not_fit_is_told_once_and_the_next_set_is_published(tmp_path, user, frames,
                                                                      settings):
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras',
                 params=settings | {'patience': 3.0}) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        left, right = (Camera(user, each) for each in frames.values())
        came = [user.listen(kind, topic, qos) for kind, topic, qos in TOPICS]
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)

        def value(key):
            return {each.key: each.value for each in states[-1].status[0].values}.get(key)

        left.tell()
        for number in range(5):  # its camera_info does not come
            right.shoot(number * SECOND)
        user.wait(lambda: 'no camera_info that can be used has come on right/camera_info'
                  in node.log, 'the reason')
        right.tell(distortion=[0.1] * 3)
        user.wait(lambda: 'plumb_bob distortion [0.1, 0.1, 0.1] has 3 coefficients' in node.log,
                  'its refusal')
        right.tell()

        for number in range(10, 14):  # one is silent
            left.shoot(number * SECOND)
        user.wait(lambda: value('dropped') == '5', 'four pictures, and one of the right camera')
        for number in range(20, 24):  # clocks differ
            left.shoot(number * SECOND)
            right.shoot(number * SECOND + 20 * MS)
        user.wait(lambda: value('dropped') == '13', 'as many more, of each camera')
        for number in range(30, 35):
            right.shoot(number * SECOND, right.frame.image[::2, ::2])
        sets = shot_until(user, lambda: all(came), (right, left), 40)
        assert all(len(each) == 1 for each in came)
        user.wait(lambda: value('frames out') == '1', 'its count')
        assert int(value('pictures of left')) == 8 + len(sets)
        assert int(value('errors')) > 4
        log = node.log
    assert equal([each[0] for each in came], sent_by(frames, settings, sets[-1]))
    for reason in ('right/image_raw: no camera_info that can be used has come',
                   'right/image_raw: frame .* has 100x84 px, its camera .* 200x168',
                   'dropped set .*: no usable picture of right within 0.01 s; the last of right',
                   'dropped set .*: no usable picture of left within 0.01 s; the last of left'):
        assert 0 < len(re.findall(reason, log)) < 4, reason  # it came more often
    assert 'Traceback' not in log


def test_a_node_that_is_active_again_begins_anew(tmp_path, user, frames, settings):
    """With the stamps, too: a clock was set, or a bag is played again."""
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras', params=settings) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        left, right = (Camera(user, each) for each in frames.values())
        came = [user.listen(kind, topic, qos) for kind, topic, qos in TOPICS]
        left.tell()
        right.tell()
        right.shoot(40 * SECOND)
        left.shoot(40 * SECOND)
        user.wait(lambda: all(came), 'the views')
        left.shoot(50 * SECOND)  # it waits, and is forgotten

        publishers = [each for camera in (left, right) for each in (camera.image, camera.info)]
        assert user.change('fixed_cameras', DEACTIVATE), node.log
        user.wait(lambda: not any(each.get_subscription_count() for each in publishers),
                  'the subscriptions to go')
        assert user.change('fixed_cameras', ACTIVATE), node.log
        user.wait(lambda: all(each.get_subscription_count() for each in publishers),
                  'the subscriptions')
        user.meet('fixed_cameras')
        left.tell()
        right.tell()
        left.shoot(0)
        left.shoot(SECOND)
        for number in range(2):  # one after the other: topics have the depth 1
            right.shoot(number * SECOND)
            user.wait(lambda number=number: all(len(each) == 2 + number for each in came),
                      'the views')
        user.wait(lambda: node.log.count('published set') == 3, 'their lines')
        log = node.log
    for messages, number in zip(zip(*came, strict=True), (40, 0, 1), strict=True):
        assert equal(messages, sent_by(frames, settings, number * SECOND))
    published = [int(each) for each in re.findall(r'published set (\d+)', log)]
    assert published == [frames['right'].stamp_ns + number * SECOND for number in (40, 0, 1)]
    assert 'Traceback' not in log


def test_poses_are_taken_as_the_command_writes_them(tmp_path, user, frames, settings):
    given = {'cameras': [*frames], 'camera_mounts': [
        float(number) for each in frames.values() for number in (
            *each.pose[:3, 3], *Rotation.from_matrix(each.pose[:3, :3]).as_euler('xyz'))]}
    mounts = tmp_path / 'cameras.yaml'
    mounts.write_text(yaml.safe_dump({'/**/fixed_cameras': {'ros__parameters': given}}))
    own = settings | {'camera_poses': ''}
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras', '--ros-args', '--params-file', mounts,
                 params=own) as node:
        came = published(node, user, frames)
    assert equal(came, sent_by(frames, own))


def test_rectified_pictures_are_of_the_pinhole_that_their_camera_info_tells(
        tmp_path, user, frames, settings):
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras',
                 params=settings | {'rectified': True}) as node:
        came = published(node, user, frames, RectifiedCamera)
    plain = {name: replace(each, lens=Lens(each.lens.pinhole)) for name, each in frames.items()}
    assert equal(came, sent_by(plain, settings))


def test_what_a_camera_s_mask_leaves_out_is_transparent_in_its_view(tmp_path, user, frames,
                                                                   settings):
    path, mask = tmp_path / 'mount.png', np.full(frames['right'].image.shape[:2], 255, np.uint8)
    mask[:, :40] = 0
    cv2.imwrite(str(path), mask)
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras',
                 params=settings | {'masks': ['', str(path)]}) as node:
        came = published(node, user, frames)
    found, plain = (posed_views_from(*messages).views
                    for messages in (came, sent_by(frames, settings)))
    assert found[0].mask is None
    right = frames['right'].lens
    np.testing.assert_array_equal(found[1].mask, right.undistorted_mask(
        mask > 0, frames['left'].lens.pinhole))
    assert 0.1 < (~found[1].mask).mean() < 0.3
    for one, other in zip(found, plain, strict=True):
        np.testing.assert_array_equal(one.picture, other.picture)


def test_a_mask_of_another_size_is_told(tmp_path, user, frames, settings):
    path = tmp_path / 'mount.png'
    cv2.imwrite(str(path), np.full(frames['right'].image.shape[:2], 255, np.uint8))
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras',
                 params=settings | {'masks': [str(path), '']}) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        left = Camera(user, frames['left'])
        left.tell()
        left.shoot()
        user.wait(lambda: re.search('left/image_raw: frame .*: the mask has 200x168 px, its camera'
                                    ' 240x180: give', node.log), 'the reason')
        assert user.state('fixed_cameras') == ACTIVE


def test_compressed_pictures_are_taken_and_damaged_ones_told(tmp_path, user, frames, settings):
    packed = {name: cv2.imencode(kind, each.image[..., ::-1])[1].ravel()
              for (name, each), kind in zip(frames.items(), ('.png', '.jpg'), strict=True)}
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras',
                 params=settings | {'compressed': True}) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        left, right = (CompressedCamera(user, each) for each in frames.values())
        came = [user.listen(kind, topic, qos) for kind, topic, qos in TOPICS]
        for each in (left, right):
            each.tell()
        left.send(packed['left'][:40], 'rgb8; png compressed bgr8')
        left.send(packed['left'], 'bayer_rggb8; png compressed ')
        user.wait(lambda: "'bayer_rggb8; png compressed ' is a mosaic" in node.log, 'its refusal')
        left.send(packed['left'], 'rgb8; png compressed bgr8', SECOND)
        right.send(packed['right'], 'rgb8; jpeg compressed bgr8', SECOND)
        user.wait(lambda: all(came), 'the views')
        log = node.log
    assert re.search('left/image_raw/compressed: compressed image: 40 bytes of format', log)
    shown = frames | {'right': replace(frames['right'], image=cv2.imdecode(
        packed['right'], cv2.IMREAD_COLOR)[..., ::-1])}
    assert equal([each[0] for each in came], sent_by(shown, settings, SECOND))


def test_pictures_that_nobody_stamped_are_refused(tmp_path, user, frames, settings):
    """Stamps that are all 0 say nothing of what belongs together."""
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras', params=settings) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        views = user.listen(Image, 'posed_views', BIG)
        cameras = [Camera(user, frames[name]) for name in LENSES]
        for each in cameras:
            each.tell()
        for each in cameras:
            each.shoot(after=-each.frame.stamp_ns)
        user.wait(lambda: node.log.count('its stamp is 0, which is no time: let the camera') == 2,
                  'the refusals')
        for each in cameras:
            each.shoot()
        user.wait(lambda: views, 'the views')
    assert [each.header.stamp.sec for each in views] == [START // SECOND]


def test_that_all_cameras_are_silent_is_told_once(tmp_path, user, frames, settings):
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras', params=settings) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        left = Camera(user, frames['left'])
        left.tell()  # this alone is no picture

        def state():
            return (states[-1].status[0].level, states[-1].status[0].message) if states else None

        silent = ('no picture for 5 s; awaited on /left/image_raw (publishers: 1), '
                  '/right/image_raw (publishers: 0)')
        user.wait(lambda: state() == (DiagnosticStatus.WARN, silent), 'the warning')
        left.shoot()
        user.wait(lambda: state() == (DiagnosticStatus.OK, 'active'), 'it to be over')
        user.wait(lambda: state() == (DiagnosticStatus.WARN, silent), 'the next silence')
        views = user.listen(Image, 'posed_views', BIG)
        right = Camera(user, frames['right'])
        right.tell()
        right.shoot()
        user.wait(lambda: views, 'the views')
        # From then on silence is no fault: cameras may be triggered rarely.
        user.wait(lambda: state() == (DiagnosticStatus.OK, silent.replace(' 0)', ' 1)')),
                  'a silence between triggers')
        for each in (left, right):
            each.shoot(SECOND)
        user.wait(lambda: len(views) == 2, 'the next views')
        for each in (left, right):  # the rig dies
            assert user.node.destroy_publisher(each.image)
        user.wait(lambda: state() == (DiagnosticStatus.WARN, silent.replace(' 1)', ' 0)')),
                  'the silence of cameras that are gone')
        assert node.log.count(f'{silent}: do the cameras run') == 1


def test_a_picture_ends_the_silence_and_not_what_has_failed_since(
        tmp_path, user, frames, settings):
    """A camera_info was refused meanwhile: a picture of the other camera does not mend that."""
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras', params=settings) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        left, right = (Camera(user, frames[name]) for name in LENSES)

        def level():
            return states and states[-1].status[0].level

        user.wait(lambda: level() == DiagnosticStatus.WARN, 'the silence')
        right.tell(distortion=[0.1] * 3)
        user.wait(lambda: level() == DiagnosticStatus.ERROR, 'the refusal')
        refusal = states[-1].status[0].message
        assert refusal.startswith('right/camera_info: ')
        left.tell()
        left.shoot()

        def after():
            return [each.status[0] for each in states
                    if 'pictures of left' in {value.key for value in each.status[0].values}]

        user.wait(lambda: len(after()) > 2, 'seconds after the picture')
        assert {(each.level, each.message) for each in after()} == {
            (DiagnosticStatus.ERROR, refusal)}
        right.tell()
        views = user.listen(Image, 'posed_views', BIG)
        right.shoot()
        user.wait(lambda: views and level() == DiagnosticStatus.OK, 'the views')


def test_after_a_camera_info_that_is_refused_pictures_wait_for_the_next_one(
        tmp_path, user, frames, settings):
    """What was known of the camera before is of another calibration."""
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras',
                 params=settings | {'bits': 12}) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        cameras = [Camera(user, each) for each in frames.values()]
        came = [user.listen(kind, topic, qos) for kind, topic, qos in TOPICS]
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)

        def value(key):
            return {each.key: each.value for one in states[-1:]
                    for each in one.status[0].values}.get(key)

        def shoot(after):
            for each in cameras:
                each.shoot(after, dim[each.frame.name])

        dim = {name: 8 * each.image.astype(np.uint16) for name, each in frames.items()}
        for each in cameras:
            each.tell()
        shoot(0)
        user.wait(lambda: all(came), 'the first set')
        cameras[1].tell(distortion=[0.1] * 3)
        user.wait(lambda: 'plumb_bob distortion' in node.log, 'its refusal')
        shoot(SECOND)
        user.wait(lambda: value('pictures of right') == '2' and value('pictures of left') == '2',
                  'pictures that wait')
        assert value('frames out') == '1'
        cameras[1].tell()
        user.wait(lambda: all(len(each) == 2 for each in came), 'the second set')
    shown = {name: replace(each, image=full_range(dim[name], 12))
             for name, each in frames.items()}
    for number, messages in enumerate(zip(*came, strict=True)):
        assert equal(messages, sent_by(shown, settings, number * SECOND))


def test_a_hundred_pictures_of_one_camera_wait_for_another(tmp_path, user, frames, settings):
    """However long its patience: more would fill the memory."""
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras',
                 params=settings | {'patience': 100.0}) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        left, right = (Camera(user, each) for each in frames.values())
        infos = user.listen(CameraInfo, 'posed_views/camera_info', SMALL)
        left.tell()
        for number in range(102):
            left.shoot(number * SECOND)
            if number % 5 == 0:  # its history has room for ten
                user.state('fixed_cameras')  # it has taken the pictures when it answers
        right.tell()
        user.wait(lambda: 'dropped set' in node.log, 'the first to be given up')
        for number in (1, 2):
            right.shoot(number * SECOND)
        user.wait(lambda: infos, 'the oldest that waits')
    assert [header_from(each.header).stamp_ns for each in infos] == [
        frames['right'].stamp_ns + 2 * SECOND]


def test_by_how_much_a_clock_is_off_is_told(tmp_path, user, frames, settings):
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras',
                 params=settings | {'patience': 0.5}) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        left, right = (Camera(user, each) for each in frames.values())
        infos = user.listen(CameraInfo, 'posed_views/camera_info', SMALL)
        for each in (left, right):
            each.tell()
        for number in range(4):
            right.shoot(5 * SECOND + number * SECOND // 10)
            left.shoot(number * SECOND // 10)
        user.wait(lambda: 'no usable picture of right within 0.01 s; the last of right is 5.004 s '
                  'later' in node.log, 'by how much it is ahead')
        user.wait(lambda: re.search('no usable picture of left within 0.01 s; the last of left is '
                                    r'[45].\d{3} s earlier', node.log), 'the others are late')
        sets = shot_until(user, lambda: infos, (left, right), 20)
    assert [header_from(each.header).stamp_ns for each in infos] == [
        frames['right'].stamp_ns + sets[-1]]


def test_sets_that_come_too_often_are_left_out(tmp_path, user, frames, settings):
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras',
                 params=settings | {'period': 0.25}) as node:
        assert all(user.change('fixed_cameras', CONFIGURE, ACTIVATE)), node.log
        cameras = [Camera(user, each) for each in frames.values()]
        infos = user.listen(CameraInfo, 'posed_views/camera_info', SMALL)
        for each in cameras:
            each.tell()
        for count, numbers in ((3, (0, 1, 2, 3, 5, 6)), (4, [-50])):
            for number in numbers:
                for each in cameras:
                    each.shoot(number * SECOND // 10)
            user.wait(lambda count=count: len(infos) == count, 'what is published')
    assert [each.header.stamp.sec * 10 + each.header.stamp.nanosec // (SECOND // 10)
            - START * 10 // SECOND for each in infos] == [0, 3, 6, -50]


def test_what_cannot_be_used_is_told_and_can_be_mended(tmp_path, user, settings):
    shipped, black = str(ROOT / 'test' / 'data' / 'two_cameras.yaml'), tmp_path / 'black.png'
    cv2.imwrite(str(black), np.zeros((48, 64), np.uint8))
    wrong = [({'cameras': ['left', 'left']}, 'cameras left, left: one is named twice'),
             ({'cameras': ['left camera']}, 'String should match pattern'),
             ({'cameras': ['a', 'b', 'c']}, 'has 2 poses, there are 3 cameras (a, b, c)'),
             ({'fixed_frame': 'map'}, "is in frame 'base_link', the poses are in fixed_frame "
              "'map'"),
             ({'camera_mounts': [0.5] * 12}, 'camera_poses and camera_mounts both say where'),
             ({'camera_poses': '', 'camera_mounts': [0.5] * 6},
              'camera_mounts has 6 numbers, expected 6 for each of 2 cameras (left, right)'),
             ({'camera_poses': '/nowhere.yaml'}, 'there is no /nowhere.yaml'),
             ({'masks': ['/nowhere.png']},
              'masks has 1 paths, expected one for each of 2 cameras (left, right)'),
             ({'masks': ['', '/nowhere.png']}, 'there is no /nowhere.png'),
             ({'masks': [str(black), '']}, 'black.png: the mask is black everywhere')]
    if find_spec('tf2_ros') is None:
        wrong.append(({'camera_poses': ''}, 'camera_poses is empty, and tf2_ros cannot be'))
    good = {'cameras': ['left', 'right'], 'camera_poses': shipped, 'camera_mounts': [0.0],
            'fixed_frame': 'base_link', 'masks': ['']}
    with Process(tmp_path, 'pmcl_ros.nodes.fixed_cameras', params=settings) as node:
        for bad, reason in wrong:
            assert user.set('fixed_cameras', **(good | bad)) == []
            assert not user.change('fixed_cameras', CONFIGURE)
            assert reason in node.log
        assert user.set('fixed_cameras', **good) == []
        assert user.change('fixed_cameras', CONFIGURE), node.log


class Buffer:
    """In the place of tf2's buffer, as tf2_ros is not on PyPI: it has poses in base_link."""

    known: ClassVar = {}

    def __init__(self, cache):
        assert cache.nanoseconds > 0

    def lookup_transform(self, frame, child, time):
        assert (frame, time.nanoseconds) == ('base_link', 0)
        if child not in self.known:
            raise ValueError(f'{child} does not exist')
        pose = pose_to_message(self.known[child])
        at = pose.position
        return TransformStamped(child_frame_id=child, transform=Transform(
            translation=Vector3(x=at.x, y=at.y, z=at.z), rotation=pose.orientation))


@pytest.fixture
def on_tf(user, settings, monkeypatch):
    """The parameters of an active node in this process, which listens to /tf."""
    listener = SimpleNamespace(unregister=lambda: None)
    monkeypatch.setitem(sys.modules, 'tf2_ros', SimpleNamespace(
        Buffer=Buffer, TransformListener=lambda *_: listener, TransformException=ValueError))
    monkeypatch.setattr(Buffer, 'known', {})
    values = settings | {'camera_poses': ''}
    context = Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)
    node = FixedCameras(context=context, parameter_overrides=[
        Parameter(name, value=value) for name, value in values.items()])
    executor.add_node(node)
    user.others.append(executor)
    assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
    yield values
    user.others.clear()
    executor.shutdown()
    node.close()
    rclpy.shutdown(context=context)


def test_poses_come_from_tf_by_the_frames_of_the_pictures(user, frames, on_tf):
    cameras = [Camera(user, each, f'{each.name}_optical') for each in frames.values()]
    came = [user.listen(kind, topic, qos) for kind, topic, qos in TOPICS]
    states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
    for each in cameras:
        each.tell()
        each.shoot()
    user.wait(lambda: states and '/tf has no base_link -> right_optical yet: right_optical does '
              'not exist' in str(states[-1].status[0].message), 'the reason')
    Buffer.known |= {f'{each.name}_optical': each.pose for each in frames.values()}
    for each in cameras:
        each.shoot(SECOND)
    user.wait(lambda: all(came), 'the views')
    assert equal([each[0] for each in came], sent_by(frames, on_tf, SECOND))
