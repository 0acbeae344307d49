"""Joins the messages of several topics whose stamps are about the same."""

from collections import deque
from collections.abc import Sequence
from typing import Generic, TypeVar

T = TypeVar('T')


class ApproximateSynchronizer(Generic[T]):
    """Joins messages whose stamps differ by at most `slop`, the oldest first.

    A message is joined with the first of each other topic that is near enough, so `slop` is to be
    less than half the time between two messages of a topic.

    topics: the parts of a complete set. slop_ns: [ns].
    """

    def __init__(self, topics: Sequence[str], slop_ns: int) -> None:
        self._slop = slop_ns
        self._waiting: dict[str, deque[tuple[int, T]]] = {each: deque() for each in topics}

    def add(self, topic: str, stamp_ns: int, message: T) -> None:
        """Store a message. One that is older than the last of its topic replaces all of them."""
        waiting = self._waiting[topic]
        if waiting and stamp_ns < waiting[-1][0]:  # the clock was set, or a bag begins anew
            waiting.clear()
        waiting.append((stamp_ns, message))

    @property
    def longest(self) -> int:
        """How many messages wait of the topic that has most."""
        return max(map(len, self._waiting.values()))

    @property
    def decided(self) -> bool:
        """Whether nothing that is still to come belongs to the oldest set: all topics went on."""
        return all(self._waiting.values())

    def oldest(self) -> dict[str, T]:
        """What there is of the oldest set, in the order of the topics; empty: nothing waits."""
        return {topic: self._waiting[topic][0][1] for topic in self._oldest()}

    def pop(self) -> None:
        """Forget the oldest set."""
        for topic in self._oldest():
            self._waiting[topic].popleft()

    def _oldest(self) -> list[str]:
        stamps = {topic: each[0][0] for topic, each in self._waiting.items() if each}
        return [topic for topic, stamp in stamps.items()
                if stamp <= min(stamps.values()) + self._slop]
