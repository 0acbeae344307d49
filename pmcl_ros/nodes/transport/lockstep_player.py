"""Lockstep replay: a capture is played when pmcl_node has published the result of the last."""

import time
from collections.abc import Callable, Collection
from functools import cache
from typing import Any, ClassVar

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from pmcl_ros.messages.bags import Recorded, Topic
from pmcl_ros.messages.cdr import message_from
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.volume import edges_from, map_from, volume_from
from pmcl_ros.nodes.graph import PRESETS, TOPICS
from pmcl_ros.nodes.runtime.base import LATCHED
from pmcl_ros.nodes.runtime.running import pause
from pmcl_ros.nodes.transport.values import Stamped
from pmcl_ros.runtime.errors import BagError

_TYPES = {each.name: each.type for each in TOPICS}
# a message of each capture, that knows its stamp
_STAMPED = ('image_raw', 'views', 'posed_views', 'dlv', 'dlv/edges', 'dlv/contour_map')
_READERS: dict[str, Callable[[Any], Stamped]] = {
    'dlv': volume_from, 'dlv/edges': edges_from, 'dlv/contour_map': map_from}
_PARTS = {*PRESETS['raw'], *PRESETS['views'], *PRESETS['posed_views'],
          *PRESETS['dlv']} - {'camera_pose'}


class LockstepPlayer:
    """Holds a bag's messages back until `objects`, found or lost, has come of the capture before.

    A capture ends where one of its topics comes again; in which order they come is the bag's. What
    is of no capture, as an arm's poses, is played in its turn. patience: for an answer [s].
    One node is to publish `objects`.
    BagError where the bag has no topic that separates captures.
    """

    # s: for what was said before, where anything was. DDS repeats lost messages every 3 s.
    discovery: ClassVar[float] = 5.0

    def __init__(self, node: Node, topics: Collection[Topic], patience: float) -> None:
        self._patience = patience
        stamped = [(name, each.name) for name in _STAMPED for each in topics
                   if _is(each.name, name) and each.type == _TYPES[name]]
        if not stamped:
            raise BagError('in step needs captures, on one of the topics '
                           f'{", ".join(_STAMPED)}: to be played are only '
                           f'{", ".join(each.name for each in topics)}')
        self._kind, self._topic = stamped[0]
        self._seen: set[str] = set()
        self._played: int | None = None  # stamp of the capture that is being played
        self._answered: set[int] = set()
        self._heard = 0  # messages on objects
        self._answers = node.create_subscription(MarkerArray, 'objects', self._on_objects, LATCHED)
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)

    def wait_for_answerer(self, timeout: float) -> None:
        """Return once somebody publishes `objects`, and what was said there before has come.

        timeout: for somebody who does [s], else BagError. `discovery` is for what was said.
        """
        deadline = time.monotonic() + timeout
        while not self._answers.get_publisher_count():
            if time.monotonic() > deadline:
                raise BagError(f'nobody publishes {self._answers.topic_name} after {timeout:g} s: '
                               'in step needs a pmcl_node that is active')
            pause(0.05)
        # `objects` is latched: what it said last is of a replay before, and no answer to this one.
        deadline = time.monotonic() + self.discovery
        while self._heard < self._answers.get_publisher_count() and time.monotonic() < deadline:
            pause(0)
            self._executor.spin_once(timeout_sec=0.05)

    def before(self, message: Recorded) -> None:
        """To be called with each message before it is published; returns when it may be."""
        if not _of_capture(message.topic):
            return
        if message.topic in self._seen:
            self.wait()
        self._seen.add(message.topic)
        if message.topic == self._topic:
            self._played = self._stamp_of(message)
            self._answered.discard(self._played)  # of a round before

    def wait(self) -> None:
        """Return once the last capture is answered; else BagError."""
        deadline = time.monotonic() + self._patience
        while self._played is not None and self._played not in self._answered:
            if time.monotonic() > deadline:
                raise BagError(
                    f'nothing came on {self._answers.topic_name} of capture {self._played} within '
                    f'{self._patience:g} s (--patience): the log of the nodes says why')
            pause(0)
            self._executor.spin_once(timeout_sec=0.05)
        self._seen.clear()
        self._played = None

    def _on_objects(self, message: MarkerArray) -> None:
        self._heard += 1
        self._answered |= {header_from(each.header).stamp_ns
                           for each in message.markers}

    def _stamp_of(self, message: Recorded) -> int:
        read = message_from(message.cdr, message.type)
        if self._kind in _READERS:
            return _READERS[self._kind](read).header.stamp_ns
        return header_from(read.header).stamp_ns


@cache
def _of_capture(topic: str) -> bool:
    return any(_is(topic, each) for each in _PARTS)


def _is(topic: str, name: str) -> bool:
    """Whether it is this topic, in whatever namespace it was recorded."""
    return topic.endswith(f'/{name}')
