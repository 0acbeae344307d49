"""The topics of a light field: `views`, `center` and what belongs to them."""

from collections.abc import Callable
from functools import cached_property

from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros import conversions
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.nodes.audience import Output
from pmcl_ros.nodes.base import BIG, SMALL, StageNode


class Views:
    """A light field, and its messages when one of them is wanted."""

    def __init__(self, light_field: LightField, views: conversions.Buffer,
                 picture: conversions.Buffer) -> None:
        self._light_field, self._views, self._picture = light_field, views, picture

    @cached_property
    def views(self) -> conversions.LightFieldMessages:
        """`views` and what belongs to it."""
        return conversions.light_field_to_messages(self._light_field, self._views)

    @property
    def centre_info(self) -> CameraInfo:
        """`center/camera_info`."""
        return conversions.pinhole_to_message(self._light_field.header,
                                              self._light_field.grid.pinhole)

    @property
    def centre_image(self) -> Image:
        """`center/image`."""
        return conversions.picture_to_message(self._light_field.header,
                                              self._light_field.picture(), self._picture)


class ViewOutputs:
    """Publishers of light fields, for `set_up` of a node."""

    def __init__(self, node: StageNode) -> None:
        self._node = node
        self._buffers = conversions.Buffer(), conversions.Buffer()
        # the small ones first, so that `views` completes its capture
        self.outputs = [
            self._output(CameraInfo, 'center/camera_info', lambda made: made.centre_info),
            self._output(Image, 'center/image', lambda made: made.centre_image),
            self._output(CameraInfo, 'views/camera_info', lambda made: made.views.camera_info),
            self._output(Image, 'views/pupil', lambda made: made.views.pupil),
            self._output(Image, 'views', lambda made: made.views.views, BIG)]

    def of(self, light_field: LightField) -> Views:
        """What the outputs publish."""
        return Views(light_field, *self._buffers)

    def _output(self, kind: type, topic: str, message: Callable[[Views], Image | CameraInfo],
                qos: QoSProfile = SMALL) -> Output[Views]:
        publisher = self._node.publisher(kind, topic, qos)
        return Output(lambda: publisher.get_subscription_count() > 0,
                      lambda made: publisher.publish(message(made)))
