"""The topics of a light field: `views`, `center` and what belongs to them."""

from collections.abc import Callable

from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros import conversions
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.nodes.runtime.base import BIG, SMALL, StageNode
from pmcl_ros.nodes.transport.deferred_publisher import Output
from pmcl_ros.nodes.transport.values import ValuePublisher


def view_outputs(node: StageNode) -> list[Output[LightField]]:
    """Publishers of light fields, for `set_up` of a node."""
    def output(kind: type, topic: str,
               write: Callable[[LightField, conversions.Buffer], Image | CameraInfo],
               qos: QoSProfile = SMALL) -> Output[LightField]:
        publisher = ValuePublisher(node, kind, topic, qos, write)
        return Output(publisher.wanted, publisher.publish)

    # the small ones first, so that `views` completes its capture
    return [output(CameraInfo, 'center/camera_info', _centre_info),
            output(Image, 'center/image', _centre_image),
            output(CameraInfo, 'views/camera_info', _views_info),
            output(Image, 'views/pupil', conversions.pupil_to_message),
            output(Image, 'views', conversions.views_to_message, BIG)]


def _centre_info(light_field: LightField, _: conversions.Buffer) -> CameraInfo:
    return conversions.pinhole_to_message(light_field.header, light_field.grid.pinhole)


def _views_info(light_field: LightField, _: conversions.Buffer) -> CameraInfo:
    grid = light_field.grid
    return conversions.pinhole_to_message(light_field.header, grid.pinhole, grid.baseline)


def _centre_image(light_field: LightField, buffer: conversions.Buffer) -> Image:
    return conversions.picture_to_message(light_field.header, light_field.picture(), buffer)
