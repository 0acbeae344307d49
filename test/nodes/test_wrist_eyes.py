"""A picture that the simulated robot cannot keep is told, and published all the same."""

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.messages.image import picture_from
from pmcl_ros.nodes.runtime.base import SMALL
from pmcl_ros.simulated_robot.wrist_eyes import PinholeEye

PINHOLE = Pinhole(48, 40, 140.0, 140.0, 23.5, 19.5)
PICTURE = np.random.default_rng(0).integers(0, 255, (40, 48, 3), np.uint8)


def test_a_picture_that_cannot_be_kept_is_told_and_published(tmp_path, user, capfd):
    robot = Node('robot', context=user.node.context)
    executor = SingleThreadedExecutor(context=user.node.context)
    executor.add_node(robot)
    try:
        eye = PinholeEye(robot, PINHOLE, lambda _: PICTURE)
        images = []
        user.node.create_subscription(Image, 'image', images.append, SMALL)
        user.node.create_subscription(CameraInfo, 'camera_info', lambda _: None, SMALL)
        user.wait(lambda: robot.count_subscribers('/image'), 'the subscriber')
        for number, file in enumerate((tmp_path / '0.png', Path('/dev/full')), 1):
            eye.shoot(SimpleNamespace(), Header(number, 'camera'), file)
            user.wait(lambda number=number: len(images) == number, 'the picture')
            np.testing.assert_array_equal(picture_from(images[-1]), PICTURE)
    finally:
        executor.shutdown()
        robot.destroy_node()
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / '0.png'))[..., ::-1], PICTURE)
    assert 'cannot write /dev/full: No space left on device' in capfd.readouterr().err
