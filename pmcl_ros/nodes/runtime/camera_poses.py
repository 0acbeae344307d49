"""Where a moved camera is: from the topic camera_pose or from /tf."""

from typing import Any, Protocol

from geometry_msgs.msg import PoseStamped
from rclpy.duration import Duration
from rclpy.time import Time

from pmcl_ros.geometry.pose_buffer import MovingPose, PoseBuffer
from pmcl_ros.geometry.se3 import transform
from pmcl_ros.lightfield.sweep.driver_settings import SweepDriverSettings
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.nodes.runtime.arms import matrix_of, tf2
from pmcl_ros.nodes.runtime.base import MANY, StageNode
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

_KEPT = 60.0  # s: how long poses are remembered
_BEFORE = 0.05  # s: from then to an image's time its speed is measured on /tf


class CameraPoses(Protocol):
    """What knows the pose of the camera's optical frame in the fixed frame."""

    missing: str  # what is still to come where `at` is None

    def start(self) -> None:
        """Listen, while the node is active."""

    def at(self, stamp_ns: int, frame_id: str) -> MovingPose | None:
        """The camera's pose at a time; frame_id: of the image.

        None where it may still come; PoseUnavailableError where it will not.
        """


class TopicPoses:
    """Poses that somebody publishes on `camera_pose`."""

    missing = 'no pose of its time, or later, has come on camera_pose'

    def __init__(self, node: StageNode, settings: SweepDriverSettings) -> None:
        self._node, self._settings = node, settings
        self._mount = transform(settings.mount_position, settings.mount_rpy)

    def start(self) -> None:
        """Listen."""
        self._trajectory = PoseBuffer(_KEPT)
        self._node.subscribe(PoseStamped, 'camera_pose', self._on_pose, MANY)

    def at(self, stamp_ns: int, frame_id: str) -> MovingPose | None:  # noqa: ARG002 -- told by mount
        """The pose of that stamp, or between the two about it."""
        return self._trajectory.interpolated(stamp_ns, self._settings.gap)

    def _on_pose(self, message: PoseStamped) -> None:
        header, pose = pose_from(message)
        if header.frame_id != self._settings.fixed_frame:
            raise LightFieldError(f'camera_pose is told in {header.frame_id!r}, expected '
                                  f'fixed_frame {self._settings.fixed_frame!r}')
        self._trajectory.add(header.stamp_ns, pose @ self._mount)


class TfPoses:
    """Asks /tf; SettingsError where tf2_ros is not installed."""

    missing = '/tf has not been asked'

    def __init__(self, node: StageNode, settings: SweepDriverSettings) -> None:
        self._node, self._settings, self._tf = node, settings, tf2()
        if self._tf is None:
            raise SettingsError("parameter 'poses' is 'tf', but tf2_ros cannot be imported (it is "
                                "part of a full ROS, not on PyPI): use 'topic'")

    def start(self) -> None:
        """Listen."""
        self._buffer: Any = self._tf.Buffer(Duration(seconds=_KEPT))
        listener = self._tf.TransformListener(self._buffer, self._node)
        self._node.active.callback(listener.unregister)

    def at(self, stamp_ns: int, frame_id: str) -> MovingPose | None:
        """The transform at that time, and how it changed just before."""
        camera = self._settings.camera_frame or frame_id
        times = stamp_ns, stamp_ns - round(_BEFORE * 1e9)
        try:
            now, before = (matrix_of(self._buffer.lookup_transform(
                self._settings.fixed_frame, camera, Time(nanoseconds=each)).transform)
                for each in times)
        except self._tf.TransformException as error:
            self.missing = f'/tf has no {self._settings.fixed_frame} -> {camera}: {error}'
            return None
        return MovingPose.between(before, now, _BEFORE, 1)


def camera_poses(node: StageNode, settings: SweepDriverSettings) -> CameraPoses:
    """What the parameter `poses` names; which `auto` took is logged."""
    found = settings.poses == 'tf' or (settings.poses == 'auto' and tf2() is not None)
    if settings.poses == 'auto':
        node.get_logger().info('the camera is where ' + (
            '/tf says' if found else 'camera_pose says: tf2_ros is not installed'))
    return TfPoses(node, settings) if found else TopicPoses(node, settings)
