"""RawFrame -> LightField: decodes raw pictures into rectified views."""

import sys
from collections import deque
from collections.abc import Callable
from functools import partial

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import String

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decode import DecodeSettings
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.messages.header import Part, part_from
from pmcl_ros.messages.raw_frame import counts_from, metadata_from, raw_frame_from
from pmcl_ros.nodes.runtime.awaited_inputs import AwaitedInputs
from pmcl_ros.nodes.runtime.base import BIG, StageNode
from pmcl_ros.nodes.runtime.parameters import live_parameters
from pmcl_ros.nodes.runtime.running import run
from pmcl_ros.nodes.transport.deferred_publisher import DeferredPublisher
from pmcl_ros.nodes.transport.values import subscribe_value
from pmcl_ros.nodes.view_outputs import view_outputs
from pmcl_ros.runtime.errors import MessageError
from pmcl_ros.runtime.resources import calibration_file, resolve

_KEPT = 10  # metadata: those of the next captures may come before a picture is taken
_LAST_LATCHED = QoSProfile(depth=_KEPT, reliability=ReliabilityPolicy.RELIABLE,
                           durability=DurabilityPolicy.TRANSIENT_LOCAL)


class SubapertureNode(StageNode):
    """Decodes each `image_raw` with the `metadata` sent last before it, or else first after it.

    Metadata have no stamp: when they were sent tells whose they are. Where those of a picture are
    refused the picture is dropped, as the next ones are of another.
    """

    name = 'subaperture_node'
    settings_class = DecodeSettings

    def set_up(self, settings: DecodeSettings) -> None:
        """Load calibration and white images."""
        self._last: CameraMetadata | None = None
        self._decoders = _load(settings)
        self.health.back_end = 'numba'
        self.configured.enter_context(live_parameters(self, settings, self._renew))
        self._outputs = view_outputs(self)

    def start(self) -> None:
        """Listen."""
        self._last = None
        self._sent: deque[tuple[int, CameraMetadata | str]] = deque(maxlen=_KEPT)
        self._waiting: Part | None = None
        self.active.callback(self._drop_waiting, 'no metadata came before deactivation')
        self._deferred = DeferredPublisher(self, self._outputs,
                                           'no subscriber of views or center')
        self._texts = self.subscribe(String, 'metadata', self._on_metadata, _LAST_LATCHED)
        images = subscribe_value(self, Image, 'image_raw', part_from(counts_from),
                                 self._on_image, BIG)
        AwaitedInputs(self, lambda: [(self._texts, images)])

    def _renew(self, settings: DecodeSettings) -> Callable[[], None]:
        """Load what changed parameters name; that the last picture can be decoded shows it fits.

        A picture of another camera shows nothing: the next is one of the new.
        """
        decoders, last = _load(settings), self._last
        if last is not None and (last.serial == decoders.serial
                                 or '' in (last.serial, decoders.serial)):
            decoders.decoder_for(last)

        def use() -> None:
            self._decoders = decoders
            self.get_logger().info(f'decodes with calibration {settings.calibration} and white '
                                   f'image {settings.white} from now on')
        return use

    def _on_metadata(self, message: String) -> None:
        try:
            self._last = metadata_from(message)
        except MessageError as error:
            self._use(str(error))
            raise
        self._use(self._last)

    def _use(self, metadata: CameraMetadata | str) -> None:
        """Keep metadata, or why they were refused, and give them to the picture that waits."""
        self._sent.append((self.sent_ns, metadata))
        image, self._waiting = self._waiting, None
        if image is not None:
            self._publish(image, metadata)

    def _on_image(self, image: RawFrame | Part) -> None:
        self.health.frames_in += 1
        if isinstance(image, RawFrame):  # handed over, with its own
            self._last = image.metadata
            self._deferred.publish(partial(self._decoders.decode, image),
                                   f'capture {image.header.stamp_ns}')
            return
        sent_ns = self.sent_ns
        self.take_all(self._texts)
        metadata = self._metadata_of(sent_ns)
        if metadata is not None:
            self._publish(image, metadata)
            return
        self._drop_waiting('a newer one came before any metadata')
        self._waiting = image
        self.health.warn("an image waits for metadata: publish the camera's JSON on metadata")

    def _metadata_of(self, sent_ns: int) -> CameraMetadata | str | None:
        """Those of a picture sent at a time, or why they were refused; None: none have come."""
        before = [metadata for sent, metadata in self._sent if sent <= sent_ns]
        after = [metadata for sent, metadata in self._sent if sent > sent_ns]
        return next(iter(before[-1:] or after), None)

    def _drop_waiting(self, why: str) -> None:
        image, self._waiting = self._waiting, None
        if image is not None:
            self.dropped(f'capture {image.header.stamp_ns}: {why}')

    def _publish(self, image: Part, metadata: CameraMetadata | str) -> None:
        capture = f'capture {image.header.stamp_ns}'
        if isinstance(metadata, str):
            self.dropped(f'{capture}: refused {metadata}')
            return
        self._deferred.publish(
            lambda: self._decoders.decode(raw_frame_from(image.message, metadata)), capture)


def _load(settings: DecodeSettings) -> Decoders:
    calibration = Calibration.load(calibration_file(settings.calibration))
    return Decoders(calibration, resolve(settings.white, 'white'), views=settings.views,
                    size=settings.size)


def main() -> int:
    """Entry point."""
    return run(SubapertureNode)


if __name__ == '__main__':
    sys.exit(main())
