"""The topics of a light field: `views`, `center` and what belongs to them."""

from collections.abc import Callable

from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.image import picture_to_message
from pmcl_ros.messages.light_field import pupil_to_message, views_to_message
from pmcl_ros.messages.types import Buffer
from pmcl_ros.nodes.runtime.base import BIG, SMALL, StageNode
from pmcl_ros.nodes.transport.deferred_publisher import Output
from pmcl_ros.nodes.transport.values import ValuePublisher


def view_outputs(node: StageNode) -> list[Output[LightField]]:
    """Publishers of light fields, for `set_up` of a node."""
    def output(kind: type, topic: str,
               write: Callable[[LightField, Buffer], Image | CameraInfo],
               qos: QoSProfile = SMALL) -> Output[LightField]:
        publisher = ValuePublisher(node, kind, topic, qos, write)
        return Output(publisher.wanted, publisher.publish)

    # the small ones first, so that `views` completes its capture
    return [output(CameraInfo, 'center/camera_info', _centre_info),
            output(Image, 'center/image', _centre_image),
            output(CameraInfo, 'views/camera_info', _views_info),
            output(Image, 'views/pupil', pupil_to_message),
            output(Image, 'views', views_to_message, BIG)]


def _centre_info(light_field: LightField, _: Buffer) -> CameraInfo:
    return pinhole_to_message(light_field.header, light_field.grid.pinhole)


def _views_info(light_field: LightField, _: Buffer) -> CameraInfo:
    grid = light_field.grid
    return pinhole_to_message(light_field.header, grid.pinhole, grid.baseline)


def _centre_image(light_field: LightField, buffer: Buffer) -> Image:
    return picture_to_message(light_field.header, light_field.picture(), buffer)
