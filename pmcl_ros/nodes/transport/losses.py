"""Stamps, sequence numbers -> captures and messages that were published and never received."""

from collections import deque

_REMEMBERED = 100  # captures


class MissingCaptures:
    """Captures that a small topic announced and a big one did not bring. Both keep their order.

    A small message arrives even when the big one of its capture is lost: a capture that was
    announced and has not arrived when the next one does was lost on its way.
    """

    def __init__(self) -> None:
        self._announced: deque[int] = deque(maxlen=_REMEMBERED)
        self._arrived: deque[int] = deque(maxlen=_REMEMBERED)

    def announce(self, stamp_ns: int) -> None:
        """Note a capture that is to arrive, or has arrived already."""
        if stamp_ns not in self._arrived:
            self._announced.append(stamp_ns)

    def arrived(self, stamp_ns: int) -> list[int]:
        """Note an arrived capture; returns the stamps of missing captures before it."""
        self._arrived.append(stamp_ns)
        missing: list[int] = []
        if stamp_ns in self._announced:
            while (oldest := self._announced.popleft()) != stamp_ns:
                missing.append(oldest)
        return missing


class SequenceGaps:
    """Counts overwritten messages of one subscription by their publication sequence numbers.

    A history of depth 1 overwrites a message that has not been read, without a notice from DDS.
    Not counted: messages from before the first one that was read, and messages while there are
    several publishers, whose numbers are equal. (DDS counts a killed publisher for up to 20 s.)
    """

    def __init__(self) -> None:
        self._last = self._publishers = 0

    def missed(self, number: int | None, publishers: int) -> int:
        """The number of messages between the last one and this one.

        number: rclpy's `publication_sequence_number`; None where the middleware has none.
        """
        if number is None:
            return 0
        known = publishers == self._publishers == 1 and number > self._last > 0
        missed = number - self._last - 1 if known else 0
        self._last, self._publishers = number, publishers
        return missed
