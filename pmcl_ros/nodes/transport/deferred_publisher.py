"""Who listens to a node, and captures that wait for them while they may still be found."""

import time
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Generic, NamedTuple, TypeVar

from pmcl_ros.nodes.runtime.base import StageNode

# s: after a node was activated, for those who listen to be found. DDS repeats what may have been
# lost every three.
DISCOVERY = 5.0
_LOOK = 0.1  # s between two looks for them

T = TypeVar('T')


class Output(NamedTuple, Generic[T]):
    """Something that a node publishes: whether anybody wants it, and how it is published."""

    wanted: Callable[[], bool]
    publish: Callable[[T], None]


class DeferredPublisher(Generic[T]):
    """Publishes what is made of each capture to those who listen, or makes nothing.

    For `start` of a node. In the first seconds the newest capture is kept for those who have not
    been found yet. It is made when the first of them is found; nobody is waited for meanwhile.
    unheard: what to say of a capture that nobody listened to. patience: those first seconds.
    """

    def __init__(self, node: StageNode, outputs: Sequence[Output[T]], unheard: str,
                 patience: float = DISCOVERY) -> None:
        self._node, self._outputs, self._unheard = node, outputs, unheard
        self._end = time.monotonic() + patience
        self._left: list[Output[T]] = []  # which may still want the capture
        self._made, self._make = True, _nothing
        node.active.callback(self._end_waiting)
        self._timer = node.every(_LOOK, self._look)

    def tell(self, make: Callable[[], T], capture: str = 'a capture') -> None:
        """Publish what `make` returns, which is called once, or never.

        capture: what it is called in the log.
        """
        if self._left and not self._made:
            self._node.dropped('a capture: a newer one came before anybody listened')
        self._made, self._make, self._left = False, cache(make), list(self._outputs)
        self._capture = capture
        self._came = time.monotonic()
        self._look()

    def _look(self) -> None:
        made, over = self._made, time.monotonic() > self._end
        try:
            for each in [output for output in self._left if output.wanted()]:
                self._left.remove(each)
                self._made = True
                each.publish(self._make())
        except Exception:
            self._forget()
            raise
        if self._made and not made:
            self._node.done(time.monotonic() - self._came, f'published {self._capture}')
        if over:
            self._timer.cancel()
            if self._left and not self._made:
                self._node.dropped(self._unheard)
        if over or not self._left:
            self._forget()

    def _end_waiting(self) -> None:
        if self._left and not self._made:
            self._node.dropped(f'{self._unheard}, and the node was deactivated')
        self._forget()

    def _forget(self) -> None:
        self._left, self._made, self._make = [], True, _nothing


def _nothing() -> Any:
    raise AssertionError('no capture waits')
