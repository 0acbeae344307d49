"""Captures that one topic announced and another did not bring."""

from collections import deque

_REMEMBERED = 100


class MissingCaptures:
    """Tells which captures are missing, once a newer one has come. Both topics keep their order.

    A small topic's message comes when a big one's is lost: a capture that was announced and has
    not come when the next one does was lost on its way, whoever lost it.
    """

    def __init__(self) -> None:
        self._announced: deque[int] = deque(maxlen=_REMEMBERED)
        self._came: deque[int] = deque(maxlen=_REMEMBERED)

    def announced(self, stamp_ns: int) -> None:
        """A capture is on its way, or has come already."""
        if stamp_ns not in self._came:
            self._announced.append(stamp_ns)

    def came(self, stamp_ns: int) -> list[int]:
        """A capture has come; the stamps of those before it that have not."""
        self._came.append(stamp_ns)
        missing: list[int] = []
        if stamp_ns in self._announced:
            while (oldest := self._announced.popleft()) != stamp_ns:
                missing.append(oldest)
        return missing
