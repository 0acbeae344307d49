"""Publishing to subscribers that DDS may not have discovered yet."""

import time
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Generic, NamedTuple, TypeVar

from pmcl_ros.nodes.runtime.base import StageNode

# s: after activation, for subscribers to be discovered. DDS repeats lost discovery messages every
# 3 s.
DISCOVERY = 5.0
_LOOK = 0.1  # s between two looks for subscribers

T = TypeVar('T')


class Output(NamedTuple, Generic[T]):
    """A topic of a node: whether it has subscribers, and how a value is published on it."""

    wanted: Callable[[], bool]
    publish: Callable[[T], None]


class DeferredPublisher(Generic[T]):
    """Publishes the result of each capture; without subscribers the result is not computed.

    For `start` of a node. Buffers the newest capture until DDS discovers a subscriber, or until
    `patience` [s] after activation. The result is computed when the first subscriber is found.
    unclaimed: why a capture without a subscriber is dropped, for the log; empty: none need come,
    and nothing is dropped.
    """

    def __init__(self, node: StageNode, outputs: Sequence[Output[T]], unclaimed: str,
                 patience: float = DISCOVERY) -> None:
        self._node, self._outputs, self._unclaimed = node, outputs, unclaimed
        self._end = time.monotonic() + patience
        self._pending: list[Output[T]] = []  # outputs without a subscriber so far
        self._made, self._make, self._capture = True, _nothing, ''
        node.active.callback(self._end_waiting)
        self._timer = node.every(_LOOK, self._publish_to_found)

    def publish(self, make: Callable[[], T], capture: str) -> None:
        """Publish what `make` returns, which is called once at most.

        capture: its name in the log, with its stamp.
        """
        if self._pending and not self._made:
            self._drop('a newer one came before a subscriber was found')
        self._made, self._make, self._pending = False, cache(make), list(self._outputs)
        self._capture = capture
        self._came = time.monotonic()
        self._publish_to_found()

    def _publish_to_found(self) -> None:
        made, over = self._made, time.monotonic() > self._end
        try:
            for each in [output for output in self._pending if output.wanted()]:
                self._pending.remove(each)
                self._made = True
                each.publish(self._make())
        except Exception:
            self._forget()
            raise
        if self._made and not made:
            self._node.done(time.monotonic() - self._came, f'published {self._capture}')
        if over:
            self._timer.cancel()
            if self._pending and not self._made:
                self._drop(self._unclaimed)
        if over or not self._pending:
            self._forget()

    def _end_waiting(self) -> None:
        if self._pending and not self._made:
            self._drop(f'{self._unclaimed}, and the node was deactivated')
        self._forget()

    def _drop(self, why: str) -> None:
        if self._unclaimed:
            self._node.dropped(f'{self._capture}: {why}')

    def _forget(self) -> None:
        self._pending, self._made, self._make = [], True, _nothing


def _nothing() -> Any:
    raise AssertionError('no capture waits')
