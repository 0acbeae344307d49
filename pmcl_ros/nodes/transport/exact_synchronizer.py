"""Messages of several topics, joined by the capture they belong to."""

from collections.abc import Callable, Sequence
from typing import Any

_REMEMBERED = 100  # captures given up, whose other parts may still come


class ExactSynchronizer:
    """Joins messages whose stamps are equal; the newest captures only.

    A capture is given up once: what still comes of it is left alone.

    topics: what makes a capture complete. depth: incomplete captures that are kept. dropped: told,
    in words, about each capture given up because `depth` newer ones, or a complete one, came.
    main: the topic whose subscription counts what it missed; where it did not come, that has been
    counted, and `dropped` gets a count of 0 too.
    """

    def __init__(self, topics: Sequence[str], depth: int, dropped: Callable[..., None],
                 main: str = '') -> None:
        self._main = main
        self._topics, self._depth, self._dropped = tuple(topics), depth, dropped
        self._captures: dict[int, dict[str, Any]] = {}  # as they began
        self._given_up: dict[int, set[str]] = {}  # what of them had not come

    def add(self, topic: str, stamp_ns: int, message: Any) -> tuple[Any, ...] | None:
        """Keep a message; all of its capture, in the order of the topics, once it is complete."""
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
            told = f'capture {stamp}: no {" or ".join(missing)} came with it'
            if self._main in missing:
                self._dropped(told, 0)
            else:
                self._dropped(told)
