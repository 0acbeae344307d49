"""A camera that takes pictures: its interface, retries, and the queue of unpublished pictures."""

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from pmcl_ros.runtime.errors import CameraError, LinkError

_LOG = logging.getLogger(__name__)

_T = TypeVar('_T')
_FIRST_PAUSE, _LONGEST_PAUSE = 0.02, 2.0  # seconds before a retry, doubled each time
_TRIES = 3  # another client of the camera can spoil a download, but not each time


@dataclass(frozen=True)
class CameraStatus:
    """Identity and state of a camera. battery: percent; None: the camera has none."""

    serial: str
    firmware: str
    battery: float | None

    def __str__(self) -> str:
        battery = '' if self.battery is None else f', battery {self.battery:.0f} %'
        return f'Lytro {self.serial} ({self.firmware}){battery}'


@dataclass(frozen=True)
class Picture:
    """A picture on the camera's card.

    id: the source's own name of the picture; a Lytro's is 'sha1-' and 40 hex digits.
    shutter_ns: time of the shutter, nanoseconds since the epoch.
    """

    id: str
    shutter_ns: int


class CameraClient(Protocol):
    """Interface of a camera. Every method may raise CameraError and may be called again then."""

    def status(self) -> CameraStatus:
        """Who the camera is and how it is."""

    def pictures(self) -> list[Picture]:
        """All pictures on the card, oldest first, fetched or not."""

    def capture(self) -> Picture:
        """Take a picture; returns when it can be fetched."""

    def fetch(self, picture: Picture) -> tuple[bytes, str]:
        """The complete .RAW (12 bits, packed) and .TXT (JSON) of a picture."""

    def delete(self, picture: Picture) -> None:
        """Delete a picture from the card."""

    def close(self) -> None:
        """End every connection."""


def retry(attempt: Callable[[], _T], lost: type[LinkError], patience: float,
          closed: threading.Event, received: Callable[[], int]) -> _T:
    """The result of `attempt`, repeated after each `lost` connection.

    patience: seconds until the error is raised; they begin again while `received`, the number of
    bytes so far, grows. closed: ends the retries.
    """
    pause, before, began = _FIRST_PAUSE, received(), time.monotonic()
    while True:
        try:
            return attempt()
        except lost as error:
            if received() > before:
                pause, before, began = _FIRST_PAUSE, received(), time.monotonic()
            if time.monotonic() + pause > began + patience:
                raise
            _LOG.info('trying again in %.2f s: %s', pause, error)
            if closed.wait(pause):
                raise
            pause = min(2 * pause, _LONGEST_PAUSE)


class Pace:
    """The least pace of a download: it ends, however slowly it drips and however often it is lost.

    what: its name. patience: seconds beside those for its bytes. slowest: bytes per second.
    """

    def __init__(self, what: str, patience: float, slowest: float) -> None:
        self._what, self._patience, self._slowest = what, patience, slowest
        self._began = time.monotonic()

    def check(self, got: int, total: int) -> None:
        """Raises CameraError, which is not tried again, when `total` bytes take too long."""
        longest = self._patience + total / self._slowest
        if got < total and time.monotonic() > self._began + longest:
            raise CameraError(f'{self._what}: {got} of {total} bytes came within {longest:.0f} s, '
                              'too slow to wait for; bring the camera nearer')


class PictureQueue:
    """Pictures taken since construction, by any client, that are not published yet.

    The list of the camera's card decides: it holds a picture even if its announcement, reply or
    download was lost. Raises the CameraErrors of the camera.
    """

    def __init__(self, camera: CameraClient) -> None:
        self._camera = camera
        self._done = {each.id for each in camera.pictures()}
        self._failed: Counter[str] = Counter()

    def waiting(self) -> list[Picture]:
        """Pictures to publish, oldest first."""
        pictures = self._camera.pictures()
        ids = {each.id for each in pictures}
        self._done &= ids  # forget deleted pictures
        for each in self._failed.keys() - ids:
            del self._failed[each]
        return [each for each in pictures if each.id not in self._done]

    def done(self, picture: Picture) -> None:
        """Mark a picture as published, or as impossible to publish."""
        self._done.add(picture.id)

    def failed(self, picture: Picture) -> bool:
        """Count a download that is no picture; True after three: it is given up."""
        self._failed[picture.id] += 1
        if self._failed[picture.id] < _TRIES:
            return False
        self.done(picture)
        return True
