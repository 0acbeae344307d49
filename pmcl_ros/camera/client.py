"""What the driver asks of a camera, whether it is reached by its own Wi-Fi or by a gateway."""

from dataclasses import dataclass
from typing import Protocol


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

    def close(self) -> None:
        """End every connection."""
