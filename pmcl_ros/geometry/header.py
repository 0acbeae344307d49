"""The identity of a capture, carried by every value that is made from it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Header:
    """Which capture a value belongs to.

    stamp_ns: time of the shutter, nanoseconds since the epoch.
    frame_id: the camera's optical frame (x right, y down, z forward; REP-103).
    """

    stamp_ns: int = 0
    frame_id: str = 'lytro_optical_frame'
