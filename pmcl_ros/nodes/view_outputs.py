"""LightField -> `views`, `center/...`; PosedViews -> `posed_views`, ...: publishers for nodes."""

from collections.abc import Callable
from typing import Any, TypeVar

from geometry_msgs.msg import PoseArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.image import picture_to_message
from pmcl_ros.messages.light_field import pupil_to_message, views_to_message
from pmcl_ros.messages.posed_views import (
    info_to_message,
    mosaic_to_message,
    poses_to_message,
    sigma_to_message,
)
from pmcl_ros.messages.types import Buffer
from pmcl_ros.nodes.runtime.base import BIG, SMALL, StageNode
from pmcl_ros.nodes.transport.deferred_publisher import Output
from pmcl_ros.nodes.transport.values import Stamped, ValuePublisher

V = TypeVar('V', bound=Stamped)


def view_outputs(node: StageNode) -> list[Output[LightField]]:
    """Publishers of light fields, for `set_up` of a node."""
    # the small ones first, so that `views` completes its capture
    return [_output(node, CameraInfo, 'center/camera_info',
                    lambda field, _: pinhole_to_message(field.header, field.pinhole)),
            _output(node, Image, 'center/image', lambda field, buffer: picture_to_message(
                field.header, field.picture(), buffer)),
            _output(node, CameraInfo, 'views/camera_info', lambda field, _: pinhole_to_message(
                field.header, field.pinhole, field.grid.baseline)),
            _output(node, Image, 'views/pupil', pupil_to_message),
            _output(node, Image, 'views', views_to_message, BIG)]


def posed_view_outputs(node: StageNode) -> list[Output[PosedViews]]:
    """Publishers of posed views, for `set_up` of a node."""
    return [_output(node, CameraInfo, 'posed_views/camera_info',
                    lambda views, _: info_to_message(views)),
            _output(node, PoseArray, 'posed_views/poses',
                    lambda views, _: poses_to_message(views)),
            _output(node, Image, 'posed_views/sigma', lambda views, _: sigma_to_message(views)),
            _output(node, Image, 'posed_views', mosaic_to_message, BIG)]


def _output(node: StageNode, kind: type, topic: str, write: Callable[[V, Buffer], Any],
            qos: QoSProfile = SMALL) -> Output[V]:
    publisher = ValuePublisher(node, kind, topic, qos, write)
    return Output(publisher.wanted, publisher.publish)
