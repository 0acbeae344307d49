"""Joins the messages of several topics that have the same stamp."""

from collections.abc import Callable, Sequence
from typing import Any

_REMEMBERED = 100  # captures given up, whose late parts are ignored


class ExactSynchronizer:
    """Joins messages with equal stamps into captures; keeps the newest incomplete captures only.

    A capture is given up when `depth` newer ones, or a complete one, came. Late messages of it are
    ignored.

    topics: the parts of a complete capture. depth: number of incomplete captures that are kept.
    dropped: called with a text for each capture that is given up.
    """

    def __init__(self, topics: Sequence[str], depth: int, dropped: Callable[[str], None]
                 ) -> None:
        self._topics, self._depth, self._dropped = tuple(topics), depth, dropped
        self._captures: dict[int, dict[str, Any]] = {}  # as they began
        self._given_up: dict[int, set[str]] = {}  # what of them had not come

    def add(self, topic: str, stamp_ns: int, message: Any) -> tuple[Any, ...] | None:
        """Store a message; returns the parts of a complete capture in the order of the topics."""
        if topic in self._given_up.get(stamp_ns, ()):
            self._given_up[stamp_ns].remove(topic)
            return None
        self._given_up.pop(stamp_ns, None)  # what had come comes again, as of a bag played again
        capture = self._captures.setdefault(stamp_ns, {})
        capture[topic] = message
        complete = len(capture) == len(self._topics)
        if complete:
            begun = list(self._captures)
            self._give_up(begun[:begun.index(stamp_ns)])
            del self._captures[stamp_ns]
            return tuple(capture[each] for each in self._topics)
        self._give_up(list(self._captures)[:-self._depth])
        return None

    def _give_up(self, stamps: list[int]) -> None:
        for stamp in stamps:
            capture = self._captures.pop(stamp)
            missing = [each for each in self._topics if each not in capture]
            self._given_up[stamp] = set(missing)
            for old in list(self._given_up)[:-_REMEMBERED]:
                del self._given_up[old]
            self._dropped(f'capture {stamp}: no {" or ".join(missing)} came with it')
