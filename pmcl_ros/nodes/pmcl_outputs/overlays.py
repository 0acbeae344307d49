"""Centre views or PosedViews, and what draws on them -> `overlay`."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros.drawing.pictures import contact_sheet
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.messages.camera_info import pinhole_from
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.image import picture_from, picture_to_message
from pmcl_ros.nodes.runtime.base import SMALL, StageNode

_PICTURES = 4  # kept, and more as long as these are not larger together:
_MOST_BYTES = 1 << 27  # a search may take as long as many captures
_CAPTURES = 256  # of which something is kept

T = TypeVar('T')
Draw = Callable[[NDArray[np.uint8], Pinhole], NDArray[np.uint8]]


class Overlays:
    """Keeps the last centre views, and publishes the drawing on one of them on `overlay`.

    For `set_up` of a node.
    """

    def __init__(self, node: StageNode) -> None:
        self._node = node
        self._publisher = node.publisher(Image, 'overlay', SMALL)
        self.forget()

    def forget(self) -> None:
        """Drop all messages received so far."""
        self._pictures: dict[int, Image] = {}
        self._cameras: dict[int, Pinhole] = {}

    def on_camera(self, message: CameraInfo) -> None:
        """Callback of center/camera_info."""
        _keep(self._cameras, message, pinhole_from(message))

    def on_picture(self, message: Image) -> None:
        """Callback of center/image."""
        picture_from(message)
        _keep(self._pictures, message, message)

    def publish(self, header: Header, pinhole: Pinhole, draw: Draw) -> None:
        """Draw on the picture of a capture, if it has come and the topic has a subscriber.

        pinhole: of the volume. It is used for the picture too where no center/camera_info came.
        """
        message = self._pictures.get(header.stamp_ns)
        if not self._publisher.get_subscription_count():
            return
        if message is None:
            if header.stamp_ns < min(self._pictures, default=0):
                self._node.get_logger().warning(
                    f'no overlay of capture {header.stamp_ns}: {len(self._pictures)} newer '
                    'center/image have come since', once=True)
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

    def publish_views(self, views: PosedViews, draw: Callable[[PosedView], NDArray[np.uint8]]
                      ) -> None:
        """Draw on each view, if the topic has a subscriber."""
        if self._publisher.get_subscription_count():
            drawn = [draw(view) for view in views.views]
            self._publisher.publish(picture_to_message(views.header, contact_sheet(drawn)))


def _keep(kept: dict[int, T], message: CameraInfo | Image, value: T) -> None:
    """Add the value of a capture; drop those of old captures."""
    kept[header_from(message.header).stamp_ns] = value
    while len(kept) > _CAPTURES or (len(kept) > _PICTURES and isinstance(message, Image)
                                    and len(kept) * len(message.data) > _MOST_BYTES):
        del kept[next(iter(kept))]
