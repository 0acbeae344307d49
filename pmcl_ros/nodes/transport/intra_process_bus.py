"""Values passed by reference between the nodes of one process."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

_REMEMBERED = 8  # values whose messages may still arrive


class IntraProcessSubscription:
    """A node's subscription to the values of a topic: a history of depth 1."""

    def __init__(self, node: str, wake: Callable[[], None]) -> None:
        self.node = node
        self._wake = wake
        self._lock = Lock()
        self._newest: list[Any] = []
        self._replaced = 0
        self.received_any = False  # since the subscription was made
        self._also_sent: deque[int] = deque(maxlen=_REMEMBERED)

    def put(self, value: Any, stamp_ns: int, sent: bool) -> None:
        """Store a value; from any thread."""
        with self._lock:
            self.received_any = True
            self._replaced += len(self._newest)
            self._newest = [value]
            if sent:
                self._also_sent.append(stamp_ns)
        self._wake()

    def take(self) -> tuple[list[Any], int]:
        """The new value, if there is one, and the number of values that it replaced."""
        with self._lock:
            newest, self._newest = self._newest, []
            replaced, self._replaced = self._replaced, 0
        return newest, replaced

    def is_duplicate(self, stamp_ns: int) -> bool:
        """Whether a message repeats a value that came by reference; true once for each value."""
        with self._lock:
            if stamp_ns not in self._also_sent:
                return False
            self._also_sent.remove(stamp_ns)
            return True


class IntraProcessBus:
    """The intra-process subscriptions of the nodes of one graph.

    Topics have their resolved names, so that namespaces and remaps hold as for messages. Values
    are shared, not copied: neither publisher nor subscribers write to them.
    """

    def __init__(self) -> None:
        self._lock = Lock()  # held while subscriptions are read or changed
        self._subscribers: dict[str, list[IntraProcessSubscription]] = {}

    @contextmanager
    def subscribed(self, topic: str, node: str,
               wake: Callable[[], None]) -> Iterator[IntraProcessSubscription]:
        """A subscription to the values of a topic, for the time of the context.

        node: the subscriber's full name, which its subscription to the ROS topic has too. wake:
        called from the publisher's thread when a value has come; never after the context ended.
        """
        subscription = IntraProcessSubscription(node, wake)
        with self._lock:
            self._subscribers.setdefault(topic, []).append(subscription)
        try:
            yield subscription
        finally:
            with self._lock:
                self._subscribers[topic].remove(subscription)

    def subscribers(self, topic: str) -> list[str]:
        """The full names of the nodes that subscribe to a topic."""
        with self._lock:
            return [each.node for each in self._subscribers.get(topic, ())]

    def publish(self, topic: str, value: Any, stamp_ns: int, sent: bool) -> int:
        """Pass a value to the subscribers of a topic; returns their number.

        sent: whether it is also sent as a message. The subscribers receive that message too, and
        recognise it by its stamp.
        """
        with self._lock:
            subscribers = self._subscribers.get(topic, ())
            for each in subscribers:
                each.put(value, stamp_ns, sent)
            return len(subscribers)
