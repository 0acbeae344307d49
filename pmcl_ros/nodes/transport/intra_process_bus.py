"""Values handed over by reference to nodes of the same process, beside the topics they have."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

_REMEMBERED = 8  # values whose messages may still be on their way


class IntraProcessSubscription:
    """One who takes the values of a topic: the newest, once, as from a history of depth 1."""

    def __init__(self, node: str, wake: Callable[[], None]) -> None:
        self.node = node
        self._wake = wake
        self._lock = Lock()
        self._newest: list[Any] = []
        self._replaced = 0
        self.given = False  # whether anything ever was
        self._doubled: deque[int] = deque(maxlen=_REMEMBERED)

    def put(self, value: Any, stamp_ns: int, sent: bool) -> None:
        """Leave a value here; any thread may."""
        with self._lock:
            self.given = True
            self._replaced += len(self._newest)
            self._newest = [value]
            if sent:
                self._doubled.append(stamp_ns)
        self._wake()

    def take(self) -> tuple[list[Any], int]:
        """What was left since the last time: one value or none; how many it took the place of."""
        with self._lock:
            newest, self._newest = self._newest, []
            replaced, self._replaced = self._replaced, 0
        return newest, replaced

    def had(self, stamp_ns: int) -> bool:
        """Whether a message is one that was handed over too; each is so once."""
        with self._lock:
            if stamp_ns not in self._doubled:
                return False
            self._doubled.remove(stamp_ns)
            return True


class IntraProcessBus:
    """What the nodes of one graph that live in one process share: who of them takes which topic.

    Topics go by their resolved names, so that namespaces and remaps count as they do for messages.
    No value is copied: it belongs to all who hold it, and none of them writes to it. Its maker
    makes a new one for the next capture; this one's memory is free when the last has let it go.
    """

    def __init__(self) -> None:
        self._lock = Lock()  # who has it knows that the takers are there, and stay
        self._takers: dict[str, list[IntraProcessSubscription]] = {}

    @contextmanager
    def taking(self, topic: str, node: str,
               wake: Callable[[], None]) -> Iterator[IntraProcessSubscription]:
        """Take the values of a topic while it lasts.

        node: the taker's full name, which its subscription to the topic has too. wake: called from
        the giver's thread when there is something to take, and never after the end.
        """
        taker = IntraProcessSubscription(node, wake)
        with self._lock:
            self._takers.setdefault(topic, []).append(taker)
        try:
            yield taker
        finally:
            with self._lock:
                self._takers[topic].remove(taker)

    def takers(self, topic: str) -> list[str]:
        """The names of the nodes that take a topic."""
        with self._lock:
            return [each.node for each in self._takers.get(topic, ())]

    def give(self, topic: str, value: Any, stamp_ns: int, sent: bool) -> int:
        """Hand a value over; to how many.

        sent: whether it will also be sent as a message, which the takers get as everybody does and
        know again by its stamp.
        """
        with self._lock:
            takers = self._takers.get(topic, ())
            for each in takers:
                each.put(value, stamp_ns, sent)
            return len(takers)
