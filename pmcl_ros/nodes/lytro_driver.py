"""camera -> RawFrame: publishes pictures that lie on disk as the camera would."""

import sys
import time

from sensor_msgs.msg import Image
from std_msgs.msg import String

from pmcl_ros.camera.files import list_pictures, read_raw_frame
from pmcl_ros.camera.settings import CameraSettings
from pmcl_ros.conversions import Buffer, raw_frame_to_messages
from pmcl_ros.errors import CameraError
from pmcl_ros.header import Header
from pmcl_ros.nodes.base import BIG, LATCHED, StageNode
from pmcl_ros.nodes.resources import resolve
from pmcl_ros.nodes.running import run


class LytroDriver(StageNode):
    """Publishes `metadata`, then `image_raw`, for each picture: on a timer, or on `~/capture`."""

    name = 'lytro_driver'
    settings_class = CameraSettings

    def set_up(self, settings: CameraSettings) -> None:
        """Find the pictures."""
        self._settings = settings
        self._pictures = list_pictures(resolve(settings.source, 'source'))
        self._metadata = self.publisher(String, 'metadata', LATCHED)
        self._image = self.publisher(Image, 'image_raw', BIG)
        self._buffer = Buffer()
        self.get_logger().info(f'{len(self._pictures)} pictures in {settings.source}')

    def start(self) -> None:
        """Begin with the first picture."""
        self._next = 0
        self.serve('~/capture', self._capture)
        if self._settings.period > 0:
            self._timer = self.every(self._settings.period, self._due)

    def _due(self) -> None:
        if self._next == len(self._pictures) and not self._settings.loop:
            self.get_logger().info(f'all {len(self._pictures)} pictures are published')
            self._timer.cancel()
        else:
            self._capture()

    def _capture(self) -> str:
        """Publish the next picture; stamp: now, the time of the shutter."""
        if self._next == len(self._pictures):
            if not self._settings.loop:
                raise CameraError(f'all {self._next} pictures of {self._settings.source} are '
                                  'published; set loop to begin again')
            self._next = 0
        path = self._pictures[self._next]
        self._next += 1  # a picture that cannot be read is not tried for ever
        began = time.monotonic()
        header = Header(self.get_clock().now().nanoseconds, self._settings.frame_id)
        frame = read_raw_frame(path, header)
        self.health.frames_in += 1
        self.health.hardware_id = frame.metadata.serial
        metadata, image = raw_frame_to_messages(frame, self._buffer)
        self._metadata.publish(metadata)
        self._image.publish(image)
        self.health.done(time.monotonic() - began)
        return f'published {path.name} with stamp {header.stamp_ns}'


def main() -> int:
    """Entry point."""
    return run(LytroDriver)


if __name__ == '__main__':
    sys.exit(main())
