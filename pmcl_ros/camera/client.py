"""A camera that takes pictures: its interface, and the queue of unpublished pictures."""

from collections import Counter
from dataclasses import dataclass
from typing import Protocol

_TRIES = 3  # another client that uses the camera spoils a download, but not for ever


@dataclass(frozen=True)
class CameraStatus:
    """Who the camera is and how it is. battery: percent, None where there is none."""

    serial: str
    firmware: str
    battery: float | None

    def __str__(self) -> str:
        battery = '' if self.battery is None else f', battery {self.battery:.0f} %'
        return f'Lytro {self.serial} ({self.firmware}){battery}'


@dataclass(frozen=True)
class Picture:
    """A picture on the camera's card.

    id: 'sha1-' and 40 hex digits, the camera's own name for it.
    shutter_ns: time of the shutter, nanoseconds since the epoch.
    """

    id: str
    shutter_ns: int


class CameraClient(Protocol):
    """A camera to take pictures with; every method raises CameraError, and can be tried again."""

    def status(self) -> CameraStatus:
        """Who the camera is and how it is."""

    def pictures(self) -> list[Picture]:
        """What is on the card, oldest first: also what was taken and never fetched."""

    def capture(self) -> Picture:
        """Take a picture; returns when it can be fetched."""

    def fetch(self, picture: Picture) -> tuple[bytes, str]:
        """The .RAW (12 bits, packed) and the .TXT (JSON) of a picture, checked to be whole."""

    def delete(self, picture: Picture) -> None:
        """Delete a picture from the card."""

    def close(self) -> None:
        """End every connection."""


class Roll:
    """The pictures that were taken after this was made, by whomever, until they are `done`.

    A picture whose announcement, reply or download was lost is on the camera's card all the same:
    the list of the card is what counts. Raises CameraError as the camera does.
    """

    def __init__(self, camera: CameraClient) -> None:
        self._camera = camera
        self._done = {each.id for each in camera.pictures()}
        self._failed: Counter[str] = Counter()

    def waiting(self) -> list[Picture]:
        """Oldest first."""
        pictures = self._camera.pictures()
        ids = {each.id for each in pictures}
        self._done &= ids  # what is deleted need not be remembered
        for each in self._failed.keys() - ids:
            del self._failed[each]
        return [each for each in pictures if each.id not in self._done]

    def done(self, picture: Picture) -> None:
        """It is published, or can never be."""
        self._done.add(picture.id)
        del self._failed[picture.id]

    def failed(self, picture: Picture) -> bool:
        """It came, but is no picture; whether that was so often that it counts as done."""
        self._failed[picture.id] += 1
        if self._failed[picture.id] < _TRIES:
            return False
        self.done(picture)
        return True
