"""RawFrame -> LightField: decodes raw pictures into rectified views."""

import sys
from collections.abc import Callable
from functools import cached_property, partial

from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String

from pmcl_ros import conversions
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.lightfield.calibration import Calibration
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.settings import DecodeSettings
from pmcl_ros.nodes.audience import Audience, Output
from pmcl_ros.nodes.base import BIG, LATCHED, SMALL, StageNode
from pmcl_ros.nodes.live import live_parameters
from pmcl_ros.nodes.running import run
from pmcl_ros.resources import resolve


class _Decoded:
    """A light field, and its messages when one of them is wanted."""

    def __init__(self, light_field: LightField, views: conversions.Buffer,
                 picture: conversions.Buffer) -> None:
        self._light_field, self._views, self._picture = light_field, views, picture

    @cached_property
    def views(self) -> conversions.LightFieldMessages:
        return conversions.light_field_to_messages(self._light_field, self._views)

    @property
    def centre_info(self) -> CameraInfo:
        return conversions.pinhole_to_message(self._light_field.header,
                                              self._light_field.grid.pinhole)

    @property
    def centre_image(self) -> Image:
        return conversions.picture_to_message(self._light_field.header,
                                              self._light_field.picture(), self._picture)


class SubapertureNode(StageNode):
    """Decodes each `image_raw` with the `metadata` that came last before it, or first after it."""

    name = 'subaperture_node'
    settings_class = DecodeSettings

    def set_up(self, settings: DecodeSettings) -> None:
        """Load calibration and white images."""
        self._metadata: CameraMetadata | None = None
        self._decoders = _load(settings)
        self.configured.enter_context(live_parameters(self, settings, self._renew))
        self._buffers = conversions.Buffer(), conversions.Buffer()
        # the small ones first, so that `views` completes its capture
        self._outputs = [
            self._output(CameraInfo, 'center/camera_info', lambda made: made.centre_info),
            self._output(Image, 'center/image', lambda made: made.centre_image),
            self._output(CameraInfo, 'views/camera_info', lambda made: made.views.camera_info),
            self._output(Image, 'views/pupil', lambda made: made.views.pupil),
            self._output(Image, 'views', lambda made: made.views.views, BIG)]

    def start(self) -> None:
        """Listen; the metadata first, as they are taken in this order."""
        self._metadata: CameraMetadata | None = None
        self._waiting: Image | None = None
        self._audience = Audience(self, self._outputs,
                                  'an image: nobody listens to views or center')
        self.subscribe(String, 'metadata', self._on_metadata, LATCHED)
        self.subscribe(Image, 'image_raw', self._on_image, BIG)

    def _output(self, kind: type, topic: str, message: Callable[[_Decoded], Image | CameraInfo],
                qos: QoSProfile = SMALL) -> Output[_Decoded]:
        publisher = self.publisher(kind, topic, qos)
        return Output(lambda: publisher.get_subscription_count() > 0,
                      lambda made: publisher.publish(message(made)))

    def _renew(self, settings: DecodeSettings) -> Callable[[], None]:
        """Load what changed parameters name; that the last picture can be decoded shows it fits.

        A picture of another camera shows nothing: the next is one of the new.
        """
        decoders, last = _load(settings), self._metadata
        if last is not None and (last.serial == decoders.serial
                                 or '' in (last.serial, decoders.serial)):
            decoders.of(last)

        def use() -> None:
            self._decoders = decoders
            self.get_logger().info(f'decodes with calibration {settings.calibration} and white '
                                   f'image {settings.white} from now on')
        return use

    def _on_metadata(self, message: String) -> None:
        self._metadata = conversions.metadata_from(message)
        image, self._waiting = self._waiting, None
        if image is not None:
            self._audience.tell(partial(self._decode, image, self._metadata))

    def _on_image(self, image: Image) -> None:
        self.health.frames_in += 1
        conversions.counts_from(image)
        if self._metadata is not None:
            self._audience.tell(partial(self._decode, image, self._metadata))
            return
        if self._waiting is not None:
            self.dropped('an image: a newer one came before any metadata')
        self._waiting = image
        self.health.warn('an image waits for metadata')

    def _decode(self, image: Image, metadata: CameraMetadata) -> _Decoded:
        frame = conversions.raw_frame_from(image, metadata)
        return _Decoded(self._decoders.decode(frame), *self._buffers)


def _load(settings: DecodeSettings) -> Decoders:
    calibration = Calibration.load(resolve(settings.calibration, 'calibration'))
    return Decoders(calibration, resolve(settings.white, 'white'), views=settings.views,
                    size=settings.size)


def main() -> int:
    """Entry point."""
    return run(SubapertureNode)


if __name__ == '__main__':
    sys.exit(main())
