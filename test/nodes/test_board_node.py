"""A printed board tells where a camera is: against truth, alone and with sweep_driver."""

import re
import sys
from contextlib import contextmanager
from dataclasses import replace

import cv2
import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseStamped
from harness import ACTIVATE, CONFIGURE, Process
from painted_boards import painted, picture_of_board
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image
from test_object_frame import tf_message  # noqa: F401 -- a fixture

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, local, pose_of
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.image import picture_to_message
from pmcl_ros.messages.pose import pose_from, poses_from, transform_from
from pmcl_ros.nodes.board_node import BoardNode
from pmcl_ros.nodes.runtime.base import BIG, MANY, SMALL

needs_detector = pytest.mark.skipif(
    not hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector'), reason='OpenCV before 4.7')
LENS = Lens(Pinhole(640, 480, 600, 600, 322, 238), (-0.1, 0.02, 0.001, -0.001))
START, MS = 1_700_000_000_000_000_000, 1_000_000


def camera_at(azimuth, height=50, distance=0.45):
    """(4, 4) a camera that looks at the middle of a board from there [degrees, m], to it."""
    turn = Rotation.from_euler('ZX', [azimuth + 90, -90 - height], degrees=True)
    return pose_of(turn, -distance * turn.as_matrix()[:, 2])


def picture_from(board, camera):
    """(height, width, 3) uint8, distorted: the board as that camera sees it."""
    wide = Pinhole(800, 640, 600, 600, 402, 318)
    seen = painted(np.full((wide.height, wide.width), 128, np.uint8), board, inverse(camera), wide)
    # Where the pinhole sees what the lens sees at each pixel.
    size = LENS.pinhole.height, LENS.pinhole.width
    pixels = np.stack(np.indices(size)[::-1], axis=-1).reshape(-1, 2).astype(float)
    straight = cv2.undistortPoints(pixels[:, None], LENS.pinhole.matrix,
                                   np.array(LENS.distortion), P=wide.matrix)
    x, y = np.moveaxis(straight.reshape(*size, 2).astype(np.float32), -1, 0)
    return np.repeat(cv2.remap(seen, x, y, cv2.INTER_CUBIC)[..., None], 3, axis=2)


class Camera:
    """A driver."""

    def __init__(self, user, told=True):
        self.user = user
        # Of depth 1, as then what is delivered is told at once, not by the next heartbeat (3 s).
        self.image = user.publisher(Image, 'image', BIG)
        self.info = user.publisher(CameraInfo, 'camera_info', BIG)
        if told:
            self.tell()

    def tell(self, longer=1.0, aside=0.0):
        pinhole = replace(LENS.pinhole, fx=longer * LENS.pinhole.fx, fy=longer * LENS.pinhole.fy,
                          cx=LENS.pinhole.cx + aside)
        message = pinhole_to_message(Header(START, 'wrist_camera'), pinhole)
        message.d = [*LENS.distortion, 0.0]
        self.info.publish(message)
        self.user.delivered(self.info)

    def shoot(self, picture, stamp_ns, frame_id='wrist_camera'):
        self.show(picture_to_message(Header(stamp_ns, frame_id), picture))

    def show(self, message):
        self.image.publish(message)
        self.user.delivered(self.image)


def off(camera, truth):
    """By how much, in units of 0.5 mm and 1.5 mrad."""
    away = local(camera[None], truth)[0]
    return max(np.linalg.norm(away[:3]) / 0.0005, np.linalg.norm(away[3:]) / 0.0015)


@needs_detector
def test_views_of_a_camera_that_somebody_holds(tmp_path, user):
    """It stands at two places for a while; between them, and at the wall, there is no pose."""
    ring, places = CharucoRing(8, 11, 0.024), [camera_at(30), camera_at(75, 40)]
    wall = np.full((480, 640, 3), 90, np.uint8)
    with (Process(tmp_path, 'pmcl_ros.nodes.sweep_driver', params={
              'poses': 'topic', 'collect': 'rest', 'fixed_frame': 'board', 'near': 0.3,
              'far': 0.7, 'patience': 60.0}) as sweep,
          Process(tmp_path, 'pmcl_ros.nodes.board_node', params={}) as node):
        for name in ('sweep_driver', 'board_node'):
            assert all(user.change(name, CONFIGURE, ACTIVATE)), node.log + sweep.log
        poses, views = (user.listen(kind, topic, qos) for kind, topic, qos in (
            (PoseStamped, 'camera_pose', MANY), (PoseArray, 'posed_views/poses', SMALL)))
        health = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        user.listen(Image, 'posed_views', BIG)
        camera, now = Camera(user), START
        for place in places:
            picture = picture_from(ring, place)
            for _ in range(4):
                now += 100 * MS
                count = len(poses)
                camera.shoot(picture, now)
                user.wait(lambda count=count: len(poses) > count, 'a pose')
            now += 1000 * MS
            camera.shoot(wall, now)
            user.wait(lambda: _told(health) == DiagnosticStatus.WARN, 'a warning')
        user.wait(lambda: views, 'posed views')
        assert 'no camera pose: the image does not show the board --ring 8x11' in node.log
    for number, message in enumerate(poses):
        header, found = pose_from(message)
        assert header.frame_id == 'board'
        assert off(found, places[number // 4]) < 1
    assert len(views[-1].poses) == 2
    for found, place in zip(poses_from(views[-1].poses, 'views'), places, strict=True):
        assert off(found, place) < 1


def _told(health):
    """The level of the node's last report."""
    levels = [each.level for message in health for each in message.status
              if each.name == 'board_node']
    return levels[-1] if levels else None


@contextmanager
def in_this_process(user, **parameters):
    """A node whose executor spins with the user's; not yet configured."""
    context = Context()
    rclpy.init(context=context)
    node = BoardNode(context=context, parameter_overrides=[
        Parameter(name, value=value) for name, value in parameters.items()])
    executor = SingleThreadedExecutor(context=context)
    try:
        executor.add_node(node)
        user.others.append(executor)
        yield node
    finally:
        executor.shutdown()
        node.close()
        rclpy.shutdown(context=context)


def seen_at(board, degrees):
    """(4, 4) a checkerboard before the camera, turned about its axis, to the camera."""
    turn = Rotation.from_euler('xz', [35, degrees], degrees=True)
    return pose_of(turn, [0, 0, 0.5] - turn.apply(board.points.mean(axis=0)))


def test_a_checkerboard_is_a_child_of_the_camera_s_frame(user, tf_message, capfd):  # noqa: F811
    board = Checkerboard(10, 7, 0.02)
    seen = seen_at(board, 20)
    picture = picture_from(board, inverse(seen))
    with in_this_process(user, corners='10x8x2', square=0.02, broadcast_tf=True,
                         fixed_frame='table') as node:
        assert node.trigger_configure() == Result.FAILURE
        assert "corners '10x8x2' are not like 10x7" in capfd.readouterr().err
        node.set_parameters([Parameter('corners', value='10x8')])
        assert node.trigger_configure() == Result.FAILURE
        assert 'looks the same upside down' in capfd.readouterr().err
        node.set_parameters([Parameter('corners', value='10x7')])
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        transforms = user.listen(tf_message, '/tf', MANY)
        camera = Camera(user)
        camera.shoot(picture, START)
        user.wait(lambda: transforms, 'a transform')
        header, child, found = transform_from(transforms[0].transforms[0])
        assert (header, child) == (Header(START, 'wrist_camera'), 'table')
        assert off(found, seen) < 1
        poses = user.listen(PoseStamped, 'camera_pose', MANY)
        for number, frame_id in enumerate(('', 'table'), 1):  # tf2 takes neither
            camera.shoot(picture, START + number * MS, frame_id)
            user.wait(lambda frame_id=frame_id: f'frame_id is {frame_id!r}' in node.health.message,
                      'an error')
        user.wait(lambda: len(poses) == 2, 'the poses, which are told all the same')
        assert len(transforms) == 1


def test_without_tf2_msgs_the_node_says_what_to_do(user, monkeypatch, capfd):
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)  # as if it were not installed
    with in_this_process(user, corners='10x7', broadcast_tf=True) as node:
        assert node.trigger_configure() == Result.FAILURE
        error = capfd.readouterr().err
        assert 'not on PyPI): set broadcast_tf to false and use the topic camera_pose' in error
        assert 'Traceback' not in error
        node.set_parameters([Parameter('broadcast_tf', value=False)])
        assert node.trigger_configure() == Result.SUCCESS


def test_what_cannot_be_used_is_refused(user):
    board = Checkerboard(10, 7, 0.02)
    picture = picture_from(board, inverse(seen_at(board, 20)))
    with in_this_process(user, corners='10x7', square=0.02) as node:
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        camera = Camera(user)
        camera.shoot(np.full((240, 320, 3), 90, np.uint8), START)
        user.wait(lambda: 'has 320x240 px' in node.health.message, 'the size to be refused')
        camera.shoot(picture, 0)
        user.wait(lambda: 'stamp is 0, which is no time' in node.health.message, 'its refusal')
        assert (node.health.level, node.health.errors) == (DiagnosticStatus.ERROR, 2)
        camera.shoot(picture, START)
        user.wait(lambda: node.health.frames_out == 1, 'the pose')
        assert node.health.level == DiagnosticStatus.OK
        camera.tell(1.1)
        camera.shoot(picture, START + MS)
        user.wait(lambda: node.health.frames_out == 2, 'the next pose')
        assert node.health.level == DiagnosticStatus.WARN
        assert re.match('the board fits best with a focal length that is .* % shorter .*: is '
                        'camera_info that of this', node.health.message)
        camera.tell(aside=60)
        camera.shoot(picture, START + 2 * MS)
        user.wait(lambda: node.health.frames_out == 3, 'the last pose')
        assert node.health.level == DiagnosticStatus.WARN
        assert re.match(r'the board fits best with a principal point that is \(.*px aside',
                        node.health.message)


def test_an_image_waits_for_its_camera_info(user):
    board = Checkerboard(10, 7, 0.02)
    picture = picture_from(board, inverse(seen_at(board, 20)))
    with in_this_process(user, corners='10x7', square=0.02) as node:
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        poses = user.listen(PoseStamped, 'camera_pose', MANY)
        camera = Camera(user, told=False)
        camera.shoot(picture, START)
        user.wait(lambda: node.health.frames_in == 1, 'the image')
        assert node.health.errors == 0
        camera.shoot(picture, START + MS)
        user.wait(lambda: node.health.errors, 'the word that there is no calibration')
        assert 'no camera_info that can be used has come on /camera_info' in node.health.message
        camera.tell()
        user.wait(lambda: poses, 'the pose')
    assert pose_from(poses[0])[0].stamp_ns == START + MS


def test_a_camera_info_that_is_refused_ends_the_one_before_it(user, capfd):
    board = Checkerboard(10, 7, 0.02)
    picture = picture_from(board, inverse(seen_at(board, 20)))
    with in_this_process(user, corners='10x7', square=0.02) as node:
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        camera = Camera(user)
        camera.shoot(picture, START)
        user.wait(lambda: node.health.frames_out == 1, 'a pose')
        camera.info.publish(CameraInfo(width=640, height=480))
        user.wait(lambda: node.health.errors, 'its refusal')
        assert 'the focal length is 0' in capfd.readouterr().err
        for number in (1, 2):
            camera.shoot(picture, START + number * MS)
            user.wait(lambda number=number: node.health.frames_in == number + 1, 'the image')
        assert 'no camera_info that can be used has come' in node.health.message
        assert node.health.frames_out == 1


def test_rectified_images_of_16_bits(user):
    """They have no distortion, whatever camera_info tells of the images before that."""
    board = Checkerboard(10, 7, 0.02)
    truth = seen_at(board, 20)
    grey = picture_of_board(board, truth, LENS.pinhole)
    with in_this_process(user, corners='10x7', square=0.02, rectified=True) as node:
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        poses = user.listen(PoseStamped, 'camera_pose', MANY)
        camera = Camera(user)
        camera.show(Image(header=header_to_message(Header(START, 'wrist_camera')), width=640,
                          height=480, encoding='mono16', step=1280,
                          data=(grey.astype('<u2') * 256 + 85).tobytes()))
        user.wait(lambda: poses, 'a pose')
    assert off(pose_from(poses[0])[1], inverse(truth)) < 1


def test_of_images_that_come_faster_than_they_are_searched_the_newest_is_taken(user):
    board = Checkerboard(10, 7, 0.02)
    truths = [seen_at(board, degrees) for degrees in (20, 30, 40, 50)]
    pictures = [picture_from(board, inverse(each)) for each in truths]
    with in_this_process(user, corners='10x7', square=0.02) as node:
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        poses = user.listen(PoseStamped, 'camera_pose', MANY)
        camera = Camera(user)
        camera.shoot(pictures[0], START)
        user.wait(lambda: poses, 'the first pose')
        for number, picture in enumerate(pictures[1:], 1):  # the node does not spin meanwhile
            camera.image.publish(picture_to_message(Header(START + number * MS, 'c'), picture))
            assert camera.image.wait_for_all_acked(Duration(seconds=60))
        user.wait(lambda: len(poses) == 2, 'the next pose')
        assert node.health.counts == {'pictures skipped': 2}
    header, found = pose_from(poses[1])
    assert header.stamp_ns == START + 3 * MS
    assert off(inverse(found), truths[3]) < 1


def test_that_no_image_comes_is_told(user):
    with in_this_process(user, corners='10x7', compressed=True) as node:
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        user.wait(lambda: node.health.state == (
            DiagnosticStatus.WARN,
            'no picture for 5 s; awaited on /image/compressed (publishers: 0)'), 'a warning')
