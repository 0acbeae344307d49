"""Where the camera is in a fixed frame: from a topic, or from /tf."""

from typing import Protocol

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.time import Time

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_buffer import PoseBuffer
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.nodes.runtime.arms import matrix_of, tf2
from pmcl_ros.nodes.runtime.base import MANY, StageNode
from pmcl_ros.pmcl.tracking.settings import TrackingSettings
from pmcl_ros.runtime.errors import LocalizationError, PoseUnavailableError, SettingsError

_KEPT = 120.0  # s: how long poses are remembered; a search takes seconds


class TrackedCamera(Protocol):
    """What knows the pose (4, 4) of the camera in the fixed frame at a capture's time."""

    def start(self) -> None:
        """Listen, while the node is active."""

    def at(self, capture: Header) -> NDArray[np.float64]:
        """The pose; PoseUnavailableError where none is known for that time."""


class TopicCamera:
    """Poses of the optical frame that somebody publishes on `camera_pose`."""

    def __init__(self, node: StageNode, settings: TrackingSettings) -> None:
        self._node, self._settings = node, settings

    def start(self) -> None:
        """Listen."""
        self._history = PoseBuffer(_KEPT)
        self._node.subscribe(PoseStamped, 'camera_pose', self._on_pose, MANY)

    def at(self, capture: Header) -> NDArray[np.float64]:
        """The pose, between the two about that time or the nearest."""
        try:
            return self._history.nearest(capture.stamp_ns, self._settings.track_max_age)
        except PoseUnavailableError:
            raise PoseUnavailableError(
                f'no camera_pose has come of within {self._settings.track_max_age:g} s of the '
                f'capture {capture.stamp_ns} (track_max_age): publish it around the '
                "shutter's time, with the same clock") from None

    def _on_pose(self, message: PoseStamped) -> None:
        header, pose = pose_from(message)
        if header.frame_id != self._settings.track_frame:
            raise LocalizationError(f'camera_pose is told in {header.frame_id!r}, expected '
                                    f'track_frame {self._settings.track_frame!r}')
        self._history.add(header.stamp_ns, pose)


class TfCamera:
    """Asks /tf; SettingsError where tf2_ros is not installed."""

    def __init__(self, node: StageNode, settings: TrackingSettings) -> None:
        self._node, self._settings, self._tf = node, settings, tf2()
        if self._tf is None:
            raise SettingsError("parameter 'track_camera' is 'tf', but tf2_ros cannot be imported "
                                "(it is part of a full ROS, not on PyPI): use 'topic'")

    def start(self) -> None:
        """Listen."""
        self._buffer = self._tf.Buffer(Duration(seconds=_KEPT))
        listener = self._tf.TransformListener(self._buffer, self._node)
        self._node.active.callback(listener.unregister)

    def at(self, capture: Header) -> NDArray[np.float64]:
        """The transform at that time; tf2 itself refuses times that it does not know."""
        fixed = self._settings.track_frame
        try:
            found = self._buffer.lookup_transform(fixed, capture.frame_id,
                                                  Time(nanoseconds=capture.stamp_ns))
        except self._tf.TransformException as error:
            raise PoseUnavailableError(f'/tf has no {fixed} -> {capture.frame_id} at the capture '
                                       f'{capture.stamp_ns}: {error}') from error
        return matrix_of(found.transform)


def tracked_camera(node: StageNode, settings: TrackingSettings) -> TrackedCamera | None:
    """What `track_camera` names; None where tracking does not ask. What is taken is logged."""
    if settings.tracking != 'camera':
        return None
    way = settings.track_camera
    if way == 'auto':
        way = 'topic' if tf2() is None else 'tf'
    node.get_logger().info(f'the camera is where {"/tf" if way == "tf" else "camera_pose"} says, '
                           f'in {settings.track_frame}')
    return TfCamera(node, settings) if way == 'tf' else TopicCamera(node, settings)
