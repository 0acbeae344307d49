"""Poses from /tf: of the camera itself, or of the link that it is mounted on."""

import sys
from contextlib import ExitStack
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Transform, TransformStamped, Vector3

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import transform
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.nodes.runtime.pose_source import PoseNames, pose_source
from pmcl_ros.runtime.errors import SettingsError

NAMES = PoseNames('poses', 'camera_pose', 'fixed_frame', 'gap')
MOUNT = transform((0.02, 0.01, 0.08), (0.1, 0.2, 0.3))
STAMP = 1_700_000_000_000_000_000


def wrist_at(stamp_ns):
    """On its way along x at 0.1 m/s."""
    return transform((1e-10 * (stamp_ns - STAMP), 0.2, 0.9), (0.0, 0.4, 0.0))


class _Buffer:
    """In the place of tf2's buffer, as tf2_ros is not on PyPI: it knows base_link <- wrist."""

    def __init__(self, cache):
        assert cache.nanoseconds > 0

    def lookup_transform(self, frame, child, time):
        assert (frame, child) == ('base_link', 'wrist')
        pose = pose_to_message(wrist_at(time.nanoseconds))
        at = pose.position
        return TransformStamped(header=header_to_message(Header(time.nanoseconds, frame)),
                                child_frame_id=child, transform=Transform(
                                    translation=Vector3(x=at.x, y=at.y, z=at.z),
                                    rotation=pose.orientation))


@pytest.fixture
def node(monkeypatch):
    listener = SimpleNamespace(unregister=lambda: None)
    monkeypatch.setitem(sys.modules, 'tf2_ros', SimpleNamespace(
        Buffer=_Buffer, TransformListener=lambda *_: listener, TransformException=ValueError))
    with ExitStack() as active:
        yield SimpleNamespace(active=active, get_logger=lambda: SimpleNamespace(
            info=lambda _: None))


def test_a_camera_that_is_not_on_tf_is_found_by_its_mount(node):
    poses = pose_source(node, NAMES, 'auto', 'base_link', MOUNT, 'wrist')
    poses.start()
    wanted = wrist_at(STAMP) @ MOUNT
    np.testing.assert_allclose(poses.nearest(STAMP, 'camera', 0.1), wanted, atol=1e-12)
    moving = poses.interpolated(STAMP, 'camera', 0.1)
    np.testing.assert_allclose(moving.pose, wanted, atol=1e-12)
    assert moving.speed == pytest.approx(0.1, rel=1e-6)


def test_a_mount_in_no_link_is_refused(node):
    with pytest.raises(SettingsError, match='in mount_parent, which is empty: set it'):
        pose_source(node, NAMES, 'tf', 'base_link', MOUNT)
    pose_source(node, NAMES, 'tf', 'base_link', np.eye(4))  # the camera is on /tf
    pose_source(node, NAMES, 'topic', 'base_link', MOUNT)  # the topic has one link
