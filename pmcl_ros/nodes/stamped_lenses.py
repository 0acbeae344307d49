"""The lens of each picture of a camera, by the camera_info that came."""

from sensor_msgs.msg import CameraInfo

from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.messages.camera_info import lens_from
from pmcl_ros.messages.header import header_from
from pmcl_ros.runtime.errors import MessageError

_KEPT = 100  # of the last camera_info


class StampedLenses:
    """Lenses of the last camera_info messages, by stamp; None: it was refused.

    rectified: as of `lens_from`.
    last: of the last camera_info, None: there is none. refused: why, empty: none has come.
    """

    def __init__(self, rectified: bool) -> None:
        self._rectified = rectified
        self._by_stamp: dict[int, Lens | None] = {}
        self.last: Lens | None = None
        self.refused = ''

    def add(self, message: CameraInfo) -> None:
        """Raises MessageError for a camera_info that is refused; it counts as the last."""
        self.last = None  # what was told before is of another calibration
        try:
            self.last = lens_from(message, self._rectified)
        except MessageError as error:
            self.refused = str(error)
            raise
        finally:
            stamp_ns = header_from(message.header).stamp_ns
            self._by_stamp.pop(stamp_ns, None)  # the newest is the last
            self._by_stamp[stamp_ns] = self.last
            if len(self._by_stamp) > _KEPT:
                del self._by_stamp[next(iter(self._by_stamp))]

    def at(self, stamp_ns: int, before: Lens | None) -> Lens | None:
        """Of the camera_info of a picture's stamp, else `before`, else the last.

        before: the last one when the picture came.
        """
        return self._by_stamp.get(stamp_ns, before or self.last)
