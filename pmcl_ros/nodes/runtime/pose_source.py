"""The pose of a frame of the robot at the time of a capture: fixed, from a topic or from /tf."""

from threading import Lock
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.time import Time

from pmcl_ros.geometry.pose_buffer import MovingPose, PoseBuffer
from pmcl_ros.geometry.transform_tree import SPEED_INTERVAL
from pmcl_ros.lightfield.sweep.settings import check_mounted
from pmcl_ros.messages.pose import pose_from, transform_from
from pmcl_ros.nodes.runtime.base import MANY, StageNode
from pmcl_ros.runtime.errors import MessageError, PoseUnavailableError, SettingsError

Way = Literal['auto', 'fixed', 'topic', 'tf']

_KEPT = 120.0  # s: how long poses are remembered; a search takes seconds


class PoseNames(NamedTuple):
    """The names that a node gives its source of poses.

    source, frame, tolerance: the names of its parameters for the source, the fixed frame and the
    longest time to a capture; topic: of the PoseStamped messages.
    """

    source: str
    topic: str
    frame: str
    tolerance: str


class PoseSource(Protocol):
    """Poses (4, 4) of a child frame in a fixed frame [m] over time; any thread may ask.

    missing: why `interpolated` returned None.
    """

    missing: str

    def start(self) -> None:
        """Subscribe, while the node is active."""

    def nearest(self, stamp_ns: int, child_frame: str, tolerance: float) -> NDArray[np.float64]:
        """The pose at a stamp; PoseUnavailableError when there is none within `tolerance` [s]."""

    def interpolated(self, stamp_ns: int, child_frame: str, gap: float) -> MovingPose | None:
        """The pose and its speed at a stamp, from poses that are at most `gap` [s] apart.

        None: it may still come. Raises PoseUnavailableError when it will not.
        """


class FixedPose:
    """The child frame is the fixed frame."""

    missing = ''

    def start(self) -> None:
        """Nothing to subscribe to."""

    def nearest(self, stamp_ns: int, child_frame: str,  # noqa: ARG002
                tolerance: float) -> NDArray[np.float64]:  # noqa: ARG002
        """The identity."""
        return np.eye(4)

    def interpolated(self, stamp_ns: int, child_frame: str,  # noqa: ARG002
                     gap: float) -> MovingPose | None:  # noqa: ARG002
        """The identity, at rest."""
        return MovingPose(np.eye(4))


class TopicPoses:
    """Poses of one child frame, from a topic of PoseStamped messages.

    frame: that the messages must be in. offset: (4, 4) pose of the child frame in the frame whose
    poses the topic carries.
    """

    def __init__(self, node: StageNode, names: PoseNames, frame: str,
                 offset: NDArray[np.float64] | None) -> None:
        self._node, self._names, self._frame, self._offset = node, names, frame, offset
        self._lock = Lock()  # held while the buffer is used
        self.missing = ''

    def start(self) -> None:
        """Subscribe."""
        self._buffer = PoseBuffer(_KEPT)
        self._refused = ''  # why the last pose was, if it was
        self._subscription = self._node.subscribe(PoseStamped, self._names.topic, self._on_pose,
                                                  MANY)

    def nearest(self, stamp_ns: int, child_frame: str,  # noqa: ARG002 -- the topic has one
                tolerance: float) -> NDArray[np.float64]:
        """As `PoseBuffer.nearest`."""
        try:
            with self._lock:
                return self._buffer.nearest(stamp_ns, tolerance)
        except PoseUnavailableError as error:
            raise PoseUnavailableError(
                f"{self._names.topic}: {error} ({self._names.tolerance}): publish it around the "
                f"shutter's time, with the same clock, or choose another source "
                f'({self._names.source})') from None

    def interpolated(self, stamp_ns: int, child_frame: str,  # noqa: ARG002 -- the topic has one
                     gap: float) -> MovingPose | None:
        """As `PoseBuffer.interpolated`."""
        with self._lock:
            found = self._buffer.interpolated(stamp_ns, gap)
            newest = self._buffer.newest
        if found is None:
            self.missing = self._refused or self._awaited(stamp_ns, newest)
        return found

    def _awaited(self, stamp_ns: int, newest: int | None) -> str:
        topic = self._subscription.topic_name
        if newest is None:
            return (f'no pose has come on {topic} (publishers: '
                    f'{self._subscription.get_publisher_count()}): publish it there, remap the '
                    f'topic, or choose another source ({self._names.source})')
        return (f'no pose of its time, or later, has come on {topic}: the newest is '
                f'{(stamp_ns - newest) / 1e9:.3f} s older; do both have one clock?')

    def _on_pose(self, message: PoseStamped) -> None:
        header, pose = pose_from(message)
        if header.frame_id != self._frame:
            self._refused = (f'{self._names.topic} is in frame {header.frame_id!r}, expected '
                             f'{self._names.frame} {self._frame!r}')
            raise MessageError(f'{self._refused}: set one to the other')
        if header.stamp_ns == 0:
            self._refused = f'{self._names.topic} has the stamp 0, which is no time'
            raise MessageError(f'{self._refused}: let its publisher stamp the poses')
        self._refused = ''
        placed = pose if self._offset is None else pose @ self._offset
        with self._lock:
            self._buffer.add(header.stamp_ns, placed)


class TfPoses:
    """Poses from /tf, in `frame`; SettingsError where tf2_ros is not installed.

    mount: a link on /tf, and the pose (4, 4) in it of the child frame, which is not there; None:
    the child frame is on /tf.
    """

    def __init__(self, node: StageNode, names: PoseNames, frame: str,
                 mount: tuple[str, NDArray[np.float64]] | None = None) -> None:
        self._node, self._frame, self._mount, self._tf = node, frame, mount, tf2()
        self.missing = ''
        if self._tf is None:
            raise SettingsError(f"parameter {names.source!r} is 'tf', but tf2_ros cannot be "
                                "imported (it is part of a full ROS, not on PyPI): use 'topic'")

    def start(self) -> None:
        """Subscribe."""
        self._buffer = self._tf.Buffer(Duration(seconds=_KEPT))
        listener = self._tf.TransformListener(self._buffer, self._node)
        self._node.active.callback(listener.unregister)

    def nearest(self, stamp_ns: int, child_frame: str,
                tolerance: float) -> NDArray[np.float64]:  # noqa: ARG002 -- tf2 interpolates
        """The transform at a stamp, 0: the newest; tf2 itself refuses times it does not know."""
        child_frame, offset = self._mount or (child_frame, np.eye(4))
        try:
            found = self._buffer.lookup_transform(self._frame, child_frame,
                                                  Time(nanoseconds=stamp_ns))
        except self._tf.TransformException as error:
            when = f'at the capture {stamp_ns}' if stamp_ns else 'yet'
            raise PoseUnavailableError(f'/tf has no {self._frame} -> {child_frame} {when}: {error}'
                                       ) from error
        return transform_from(found)[2] @ offset

    def interpolated(self, stamp_ns: int, child_frame: str, gap: float) -> MovingPose | None:
        """The transform at a stamp, with the mean speed just before it."""
        try:
            now = self.nearest(stamp_ns, child_frame, gap)
            before = self.nearest(stamp_ns - round(SPEED_INTERVAL * 1e9), child_frame, gap)
        except PoseUnavailableError as error:
            self.missing = str(error)
            return None
        return MovingPose.between(before, now, SPEED_INTERVAL, 1)


def pose_source(node: StageNode, names: PoseNames, way: Way, frame: str,
                offset: NDArray[np.float64] | None = None, parent: str = '') -> PoseSource:
    """The source that `way` names, for `set_up` of a node; logged.

    auto: /tf where tf2_ros is installed, else the topic. frame: the fixed frame. offset: as of
    `TopicPoses`. parent: the link on /tf that the offset is in; empty: the child frame
    is on /tf, and an offset is refused (SettingsError).
    """
    if way == 'auto':
        way = 'topic' if tf2() is None else 'tf'
    source: PoseSource
    if way == 'fixed':
        source, words = FixedPose(), 'are fixed'
    elif way == 'tf':
        if offset is not None and not parent:
            check_mounted(offset)
        mount = (parent, offset) if parent and offset is not None else None
        source = TfPoses(node, names, frame, mount)
        words = 'come from /tf' + (f', by the mount in {parent}' if mount else '')
    else:
        source = TopicPoses(node, names, frame, offset)
        words = f'come from {names.topic}'
    node.get_logger().info(f'{names.source} {way}: poses in {frame} {words}')
    return source


def tf2() -> Any:
    """The module tf2_ros; None where it is not installed."""
    try:
        import tf2_ros
    except ImportError:
        return None
    return tf2_ros
