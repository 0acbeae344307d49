"""Messages of several topics, joined by the capture they belong to."""

from collections.abc import Callable, Sequence
from typing import Any


class Matching:
    """Joins messages whose stamps are equal; the newest captures only.

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

    def add(self, topic: str, stamp_ns: int, message: Any) -> tuple[Any, ...] | None:
        """Keep a message; all of its capture, in the order of the topics, once it is complete."""
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
            told = f'capture {stamp}: no {" or ".join(missing)} came with it'
            if self._main in missing:
                self._dropped(told, 0)
            else:
                self._dropped(told)
