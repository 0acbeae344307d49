"""What an ordinary camera sends: its pictures, plain or compressed, and its camera_info."""

from collections.abc import Callable
from typing import Any, TypeAlias

from numpy.typing import NDArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from pmcl_ros.lightfield.board_camera import BoardNodeSettings
from pmcl_ros.lightfield.fixed_cameras import FixedCameraSettings
from pmcl_ros.lightfield.readers.pictures import full_range
from pmcl_ros.lightfield.sweep.settings import SweepDriverSettings
from pmcl_ros.messages.image import colours_from, decompressed_from
from pmcl_ros.nodes.runtime.base import StageNode

Picture: TypeAlias = Image | CompressedImage
_MOST, _MOST_BYTES = 100, 1 << 28  # of pictures that wait


def subscribe_camera(
        node: StageNode, settings: FixedCameraSettings | SweepDriverSettings | BoardNodeSettings,
        image: str, info: str, on_picture: Callable[[Picture], None],
        on_info: Callable[[CameraInfo], None]) -> Subscription:
    """Subscribe to a camera's topics, for `start` of a node; the subscription of its pictures."""
    qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE if settings.reliable
                     else ReliabilityPolicy.BEST_EFFORT)
    node.subscribe(CameraInfo, info, on_info, qos)
    if not settings.compressed:
        return node.subscribe(Image, image, on_picture, qos)
    # As of image_transport: who remaps the plain topic remaps this one.
    return node.subscribe(CompressedImage, f'{node.resolve_topic_name(image)}/compressed',
                          on_picture, qos)


def most_waiting(size: int) -> int:
    """How many pictures of a size [bytes] may wait: their memory is limited, but for one."""
    return max(1, min(_MOST, _MOST_BYTES // max(size, 1)))


def pixels_from(picture: Picture, bits: int) -> NDArray[Any]:
    """(height, width, 3) RGB, uint8 or uint16 of full range.

    bits: of values of 16 bits that the camera fills. Raises MessageError and LightFieldError.
    """
    read = decompressed_from if isinstance(picture, CompressedImage) else colours_from
    return full_range(read(picture), bits)
