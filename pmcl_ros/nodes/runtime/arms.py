"""Where the camera's mount is in the robot's base: from a topic, from /tf, or fixed."""

from typing import Any, Protocol

import numpy as np
from geometry_msgs.msg import PoseStamped, Transform
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.time import Time

from pmcl_ros.geometry.pose_buffer import PoseBuffer
from pmcl_ros.grasps.settings import GraspSettings
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.nodes.runtime.base import SMALL, StageNode
from pmcl_ros.runtime.errors import GraspError, PoseUnavailableError, SettingsError

_KEPT = 120.0  # s: how long transforms are remembered; a search takes seconds


class Arm(Protocol):
    """What knows the pose (4, 4) of the mount's parent in the base at a capture's time."""

    def start(self) -> None:
        """Listen, while the node is active."""

    def at(self, stamp_ns: int) -> NDArray[np.float64]:
        """The pose; PoseUnavailableError where none is known for that time."""


class FixedArm:
    """The camera is fixed to the base: what mount_parent says is of no matter."""

    def start(self) -> None:
        """Nothing to listen to."""

    def at(self, stamp_ns: int) -> NDArray[np.float64]:  # noqa: ARG002 -- at all times
        """The base itself."""
        return np.eye(4)


class TopicArm:
    """Poses of mount_parent in base_frame that somebody publishes on `arm_pose`."""

    def __init__(self, node: StageNode, settings: GraspSettings) -> None:
        self._node, self._settings = node, settings

    def start(self) -> None:
        """Listen."""
        self._history = PoseBuffer(_KEPT)
        self._node.subscribe(PoseStamped, 'arm_pose', self._on_pose, SMALL)

    def at(self, stamp_ns: int) -> NDArray[np.float64]:
        """The pose, between the two about that time or the nearest."""
        try:
            return self._history.nearest(stamp_ns, self._settings.max_age)
        except PoseUnavailableError as error:
            raise PoseUnavailableError(
                f"arm_pose: {error} (max_age): publish it around the shutter's time, with the "
                'same clock, or set the parameter arm') from None

    def _on_pose(self, message: PoseStamped) -> None:
        header, pose = pose_from(message)
        if header.frame_id != self._settings.base_frame:
            raise GraspError(f'arm_pose is told in {header.frame_id!r}, expected base_frame '
                             f'{self._settings.base_frame!r}')
        self._history.add(header.stamp_ns, pose)


class TfArm:
    """Asks /tf; SettingsError where tf2_ros is not installed."""

    def __init__(self, node: StageNode, settings: GraspSettings) -> None:
        self._node, self._settings, self._tf = node, settings, tf2()
        if self._tf is None:
            raise SettingsError("parameter 'arm' is 'tf', but tf2_ros cannot be imported (it is "
                                "part of a full ROS, not on PyPI): use 'topic' or 'fixed'")

    def start(self) -> None:
        """Listen."""
        self._buffer = self._tf.Buffer(Duration(seconds=_KEPT))
        listener = self._tf.TransformListener(self._buffer, self._node)
        self._node.active.callback(listener.unregister)

    def at(self, stamp_ns: int) -> NDArray[np.float64]:
        """The transform at that time; tf2 itself refuses times that it does not know."""
        base, link = self._settings.base_frame, self._settings.mount_parent
        try:
            found = self._buffer.lookup_transform(base, link, Time(nanoseconds=stamp_ns))
        except self._tf.TransformException as error:
            raise PoseUnavailableError(f'/tf has no {base} -> {link} at the capture {stamp_ns}: '
                                       f'{error}') from error
        return matrix_of(found.transform)


def arm_of(node: StageNode, settings: GraspSettings) -> Arm:
    """What the parameter `arm` names; which `auto` took is logged."""
    if settings.arm == 'fixed':
        return FixedArm()
    if settings.arm == 'tf':
        return TfArm(node, settings)
    if settings.arm == 'topic':
        return TopicArm(node, settings)
    found = tf2() is not None
    node.get_logger().info('the arm is where ' + (
        '/tf says' if found else 'arm_pose says: tf2_ros is not installed'))
    return TfArm(node, settings) if found else TopicArm(node, settings)


def tf2() -> Any:
    """The module tf2_ros; None where it is not installed."""
    try:
        import tf2_ros
    except ImportError:
        return None
    return tf2_ros


def matrix_of(transform: Transform) -> NDArray[np.float64]:
    """(4, 4) of a Transform; MessageError when it is none."""
    message = PoseStamped()
    for axis in 'xyz':
        setattr(message.pose.position, axis, getattr(transform.translation, axis))
    message.pose.orientation = transform.rotation
    return pose_from(message)[1]
