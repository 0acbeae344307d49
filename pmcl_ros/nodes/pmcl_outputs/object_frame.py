"""PoseEstimate -> the object's frame on /tf."""

from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile

from pmcl_ros.messages.pose import estimate_to_transform
from pmcl_ros.nodes.runtime.base import StageNode
from pmcl_ros.nodes.transforms import transforms_class
from pmcl_ros.pmcl.estimate import PoseEstimate

# Latched; but tf2's listeners are volatile: to them what was sent before they came is not sent.
_TF = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class ObjectFrame:
    """Broadcasts poses on /tf, the last one again to each listener that comes later.

    For `set_up` of a node. /tf_static would be wrong: the object is where it was seen at the time
    of the capture, while the camera moves on. name: of the object's frame. Raises SettingsError
    where tf2_msgs is not installed.
    """

    def __init__(self, node: StageNode, name: str) -> None:
        self._class: Any = transforms_class('pose')
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
