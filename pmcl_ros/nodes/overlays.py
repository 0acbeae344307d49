"""Overlays: the outline of the found object on the centre view of its capture."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.messages.camera_info import pinhole_from
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.image import picture_from, picture_to_message
from pmcl_ros.nodes.runtime.base import SMALL, StageNode

_PICTURES = 4  # kept

T = TypeVar('T')
Draw = Callable[[NDArray[np.uint8], Pinhole], NDArray[np.uint8]]


class Overlays:
    """Keeps the last centre views, and publishes what is drawn on one of them on `overlay`.

    For `set_up` of a node.
    """

    def __init__(self, node: StageNode) -> None:
        self._node = node
        self._publisher = node.publisher(Image, 'overlay', SMALL)
        self.forget()

    def forget(self) -> None:
        """Keep nothing of what has come."""
        self._pictures: dict[int, Image] = {}
        self._cameras: dict[int, Pinhole] = {}

    def on_camera(self, message: CameraInfo) -> None:
        """A centre/camera_info came."""
        _keep(self._cameras, message, pinhole_from(message))

    def on_picture(self, message: Image) -> None:
        """A centre/image came."""
        picture_from(message)
        _keep(self._pictures, message, message)

    def publish(self, header: Header, pinhole: Pinhole, draw: Draw) -> None:
        """Draw on the picture of a capture, if it has come and somebody wants it.

        pinhole: of the volume, which is the picture's where no centre/camera_info came.
        """
        message = self._pictures.get(header.stamp_ns)
        if message is None or not self._publisher.get_subscription_count():
            return
        # The volume may be of a part of the picture, or coarser.
        pinhole = self._cameras.get(header.stamp_ns, pinhole)
        picture = picture_from(message)
        if picture.shape[:2] != (pinhole.height, pinhole.width):
            self._node.get_logger().warning(
                'no overlay: center/image is not of the size of the volume, and no '
                'center/camera_info came with it', once=True)
            return
        self._publisher.publish(picture_to_message(header, draw(picture, pinhole)))


def _keep(kept: dict[int, T], message: CameraInfo | Image, value: T) -> None:
    """Of the last captures."""
    kept[header_from(message.header).stamp_ns] = value
    while len(kept) > _PICTURES:
        del kept[next(iter(kept))]
