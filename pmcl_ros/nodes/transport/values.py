"""Publishers and subscriptions of values: by reference in the process, as messages elsewhere."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, Generic, Protocol, TypeVar

from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.cdr import message_from, type_name
from pmcl_ros.messages.types import Buffer
from pmcl_ros.nodes.runtime.base import StageNode

# s: after that who has not said that the first message came did not get it; likewise the next.
_ANSWER, _AGAIN = 1.0, 0.1


class Stamped(Protocol):
    """A value of one capture."""

    @property
    def header(self) -> Header:
        """Which capture."""


T = TypeVar('T', bound=Stamped)


class ValuePublisher(Generic[T]):
    """Hands each value to those who take it in this process, and sends it to all others.

    For `set_up` of a node, whose health counts what went which way. write: makes the message, in
    the buffer. each_a_capture: whether messages that nobody got before the next overwrote them
    count as dropped. Those who listen count what they miss after the first that they took (see
    `Gaps`); until one has arrived only this end can, which may find them before they find it.
    (What arrives and is overwritten before they take their first, neither end counts.)
    """

    def __init__(self, node: StageNode, kind: type, topic: str, qos: QoSProfile,
                 write: Callable[[T, Buffer], object], each_a_capture: bool = False) -> None:
        self._node, self._write, self._buffer = node, write, Buffer()
        self._publisher = node.publisher(kind, topic, qos)
        self._name, self._topic = topic, node.resolve_topic_name(topic)
        self._each_a_capture = each_a_capture
        self._listeners = 0  # when they were last looked for
        self._sent_ns = 0  # what may be the first to arrive; 0: one has
        self._patience = _ANSWER

    def wanted(self) -> bool:
        """Whether anybody listens, as far as is known."""
        return self._publisher.get_subscription_count() > 0

    def arrived(self, patience: Duration) -> bool:
        """Wait until all that was sent is in the histories of those who listen; whether it is."""
        return bool(self._publisher.wait_for_all_acked(patience))

    def publish(self, value: T) -> None:
        """Hand over, then send where somebody listens who is not handed it."""
        sent = self._others() > 0
        if self._node.hand_over.give(self._topic, value, value.header.stamp_ns, sent):
            self._node.health.count(f'{self._name} handed over')
        if sent:
            if self._each_a_capture:
                self._count_unheard(value.header.stamp_ns)
            self._publisher.publish(self._write(value, self._buffer))
            self._node.health.count(f'{self._name} sent')

    def _count_unheard(self, next_ns: int) -> None:
        listeners = self._publisher.get_subscription_count()
        if listeners > self._listeners:
            self._sent_ns, self._patience = next_ns, _ANSWER  # nothing was sent to the new one
        elif self._sent_ns and listeners and self.arrived(Duration(seconds=self._patience)):
            self._sent_ns = 0  # from here on it is they who count
        elif self._sent_ns:
            if listeners == 1:  # else another may have got it
                self._node.dropped(f'capture {self._sent_ns}: who listens to {self._name} did not '
                                   'get it before the next was published')
            self._sent_ns, self._patience = next_ns, _AGAIN
        self._listeners = listeners

    def _others(self) -> int:
        """Subscriptions but those of the takers, which are there for other publishers."""
        listening = self._node.get_subscriptions_info_by_topic(self._topic)
        names = [f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in listening]
        for taker in self._node.hand_over.takers(self._topic):
            if taker in names:  # once: a node elsewhere may have the same name
                names.remove(taker)
        return len(names)


def subscribe_value(node: StageNode, kind: type, topic: str, read: Callable[[Any], T],
                    callback: Callable[[T], None], qos: QoSProfile,
                    each_a_capture: bool = True, announced: bool = False,
                    scope: ExitStack | None = None) -> Subscription:
    """As `node.subscribe`, for `start` of a node, to values: `read` makes them of messages.

    each_a_capture: whether a value that is overwritten before it was taken is a capture lost,
    which counts as dropped; false where that shows in another topic. announced: captures are
    joined from several topics, and what did not come as a message counts there, by its stamp.
    scope: closed when the subscription is to end; default: when the node is deactivated.
    """
    scope = node.active if scope is None else scope
    ways: set[str] = set()

    def tell(way: str) -> None:
        if way not in ways:
            ways.add(way)
            node.get_logger().info(f'{topic} comes {way}')

    def missed(count: int) -> None:
        if each_a_capture and count:
            node.dropped(f'{count} of {topic}: newer came before they were taken', count)

    def received(cdr: bytes) -> None:
        value = read(message_from(cdr, type_name(kind)))
        if not taker.had(value.header.stamp_ns):
            tell('as messages')
            callback(value)

    def woken() -> None:
        with node.watched(topic):
            values, replaced = taker.take()
            missed(replaced)
            for value in values:
                tell('by reference, from a node of this process')
                callback(value)

    # What is handed over may be sent to others too, and so come twice: one of the two counts.
    subscription = node.subscribe(kind, topic, received, qos, raw=True,
                                  missed=lambda count: missed(
                                      0 if announced or taker.given else count), scope=scope)
    bell = node.create_guard_condition(woken)
    scope.callback(node.destroy_guard_condition, bell)
    taker = scope.enter_context(node.hand_over.taking(
        node.resolve_topic_name(topic), node.get_fully_qualified_name(), bell.trigger))
    return subscription
