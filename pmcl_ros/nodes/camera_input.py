"""What an ordinary camera sends: its pictures, plain or compressed, and its camera_info."""

import time
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from diagnostic_msgs.msg import DiagnosticStatus
from numpy.typing import NDArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.board_camera import BoardNodeSettings
from pmcl_ros.lightfield.fixed_cameras import FixedCameraSettings
from pmcl_ros.lightfield.readers.pictures import full_range
from pmcl_ros.lightfield.sweep.settings import SweepDriverSettings
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.image import colours_from, decompressed_from
from pmcl_ros.nodes.runtime.awaited_inputs import publishers
from pmcl_ros.nodes.runtime.base import StageNode
from pmcl_ros.runtime.errors import MessageError

Picture: TypeAlias = Image | CompressedImage
_MOST, _MOST_BYTES = 100, 1 << 28  # of pictures that wait
_SILENCE = 5.0  # s without a picture of any camera: DDS repeats a message that was lost after 3


def subscribe_camera(
        node: StageNode, settings: FixedCameraSettings | SweepDriverSettings | BoardNodeSettings,
        image: str, info: str, on_picture: Callable[[Picture], None],
        on_info: Callable[[CameraInfo], None], newest: bool = False) -> Subscription:
    """Subscribe to a camera's topics, for `start` of a node; the subscription of its pictures.

    newest: pictures that come while one is in work give way to the last of them, and are counted.
    """
    reliability = (ReliabilityPolicy.RELIABLE if settings.reliable
                   else ReliabilityPolicy.BEST_EFFORT)
    node.subscribe(CameraInfo, info, on_info, QoSProfile(depth=10, reliability=reliability))
    kind: type[Picture] = Image
    if settings.compressed:  # as of image_transport: who remaps the plain topic remaps this one
        kind, image = CompressedImage, f'{node.resolve_topic_name(image)}/compressed'

    def missed(count: int) -> None:
        if newest:
            node.health.count('pictures skipped', count)

    return node.subscribe(kind, image, on_picture, QoSProfile(
        depth=1 if newest else 10, reliability=reliability), missed=missed)


class Silence:
    """Tells that no picture of any camera comes; for `start` of a node.

    pictures: the subscriptions.
    """

    def __init__(self, node: StageNode, pictures: Sequence[Subscription]) -> None:
        self._node, self._pictures = node, pictures
        self._heard, self._told = time.monotonic(), False

    def broken(self) -> None:
        """A picture has come, or none is awaited."""
        self._heard = time.monotonic()
        self._node.health.came()

    def look(self) -> None:
        """To be called now and then: after 5 s of silence /diagnostics tells it, the log once."""
        if time.monotonic() - self._heard < _SILENCE:
            return
        awaited = ', '.join(f'{each.topic_name} ({publishers(self._node, each)})'
                            for each in self._pictures)
        text = f'no picture for {_SILENCE:g} s; awaited on {awaited}'
        # Cameras that are there may be triggered rarely.
        usual = self._node.health.frames_out and all(
            each.get_publisher_count() for each in self._pictures)
        self._node.health.awaits(text, DiagnosticStatus.OK if usual else DiagnosticStatus.WARN)
        if not self._told:
            self._told = True
            self._node.get_logger().warning(
                f'{text}: do the cameras run, are topics to be remapped, is `reliable` what they '
                'offer?')


def most_waiting(size: int) -> int:
    """How many pictures of a size [bytes] may wait: their memory is limited, but for one."""
    return max(1, min(_MOST, _MOST_BYTES // max(size, 1)))


def stamped(picture: Picture) -> Header:
    """The header of a picture; MessageError where nobody stamped it."""
    header = header_from(picture.header)
    if header.stamp_ns == 0:
        raise MessageError('its stamp is 0, which is no time: let the camera driver stamp its '
                           'images')
    return header


def pixels_from(picture: Picture, bits: int) -> NDArray[Any]:
    """(height, width, 3) RGB, uint8 or uint16 of full range.

    bits: of values of 16 bits that the camera fills. Raises MessageError and LightFieldError.
    """
    read = decompressed_from if isinstance(picture, CompressedImage) else colours_from
    return full_range(read(picture), bits)
