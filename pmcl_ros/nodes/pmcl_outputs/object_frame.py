"""PoseEstimate -> the object's frame on /tf."""

from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile

from pmcl_ros.messages.pose import estimate_to_transform
from pmcl_ros.messages.types import message_class
from pmcl_ros.nodes.runtime.base import StageNode
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.runtime.errors import BagError, SettingsError

# Latched; but tf2's listeners are volatile: to them what was sent before they came is not sent.
_TF = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class ObjectFrame:
    """Broadcasts poses on /tf, the last one again to each listener that comes later.

    For `set_up` of a node. /tf_static would be wrong: the object is where it was seen at the time
    of the capture, while the camera moves on. name: of the object's frame. Raises SettingsError
    where tf2_msgs is not installed.
    """

    def __init__(self, node: StageNode, name: str) -> None:
        try:
            self._class: Any = message_class('tf2_msgs/msg/TFMessage')
        except BagError as error:
            raise SettingsError(f"parameter 'broadcast_tf' is true, but {error}: set broadcast_tf "
                                'to false and use the topic pose') from None
        self._name, self._last = name, None
        self._publisher = node.publisher(self._class, '/tf', _TF, self._repeat)

    def broadcast(self, estimate: PoseEstimate) -> None:
        """Send the object's pose at the capture's time; of a lost object none, later neither."""
        if estimate.lost:
            self.forget()
            return
        self._last = self._class(transforms=[estimate_to_transform(estimate, self._name)])
        self._publisher.publish(self._last)

    def forget(self) -> None:
        """Repeat it no more: what is latched is replaced by a message without transforms."""
        if self._last is not None:
            self._last = None
            self._publisher.publish(self._class(transforms=[]))

    def _repeat(self) -> None:
        if self._last is not None:
            self._publisher.publish(self._last)
