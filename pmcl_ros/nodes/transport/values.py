"""Publishers and subscriptions of values: by reference within the process, else as messages."""

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

_ANSWER, _AGAIN = 1.0, 0.1  # s: acknowledgement timeouts: first message, later messages


class Stamped(Protocol):
    """A value of one capture."""

    @property
    def header(self) -> Header:
        """Which capture."""


T = TypeVar('T', bound=Stamped)


class ValuePublisher(Generic[T]):
    """Passes each value by reference within the process, and as a message to other subscribers.

    For `set_up` of a node, whose health counts the values of both ways. write: makes the message,
    in the buffer. each_a_capture: whether a message that no subscriber received before the next
    one overwrote it counts as dropped. A subscriber counts its own losses after its first message
    (`SequenceGaps`); until then this publisher counts them. (A message that arrives and is
    overwritten before a subscriber reads its first one is not counted.)
    """

    def __init__(self, node: StageNode, kind: type, topic: str, qos: QoSProfile,
                 write: Callable[[T, Buffer], object], each_a_capture: bool = False) -> None:
        self._node, self._write, self._buffer = node, write, Buffer()
        self._publisher = node.publisher(kind, topic, qos)
        self._name, self._topic = topic, node.resolve_topic_name(topic)
        self._each_a_capture = each_a_capture
        self._listeners = 0  # when last looked for
        self._sent_ns = 0  # the first message that may arrive; 0: one has arrived
        self._patience = _ANSWER

    def wanted(self) -> bool:
        """Whether DDS has discovered a subscriber."""
        return self._publisher.get_subscription_count() > 0

    def arrived(self, patience: Duration) -> bool:
        """Whether all messages arrive in the subscribers' histories within `patience`."""
        return bool(self._publisher.wait_for_all_acked(patience))

    def publish(self, value: T, each_a_capture: bool = True) -> None:
        """Pass the value by reference, then send it if other subscribers exist.

        each_a_capture: false where the capture goes on by another topic, so that a message that
        does not arrive is no capture lost.
        """
        sent = self._others() > 0
        if self._node.bus.publish(self._topic, value, value.header.stamp_ns, sent):
            self._node.health.count(f'{self._name} handed over')
        if sent:
            if self._each_a_capture and each_a_capture:
                self._count_unreceived(value.header.stamp_ns)
            self._publisher.publish(self._write(value, self._buffer))
            self._node.health.count(f'{self._name} sent')

    def _count_unreceived(self, next_ns: int) -> None:
        listeners = self._publisher.get_subscription_count()
        if listeners > self._listeners:
            self._sent_ns, self._patience = next_ns, _ANSWER  # nothing was sent to the new one
        elif self._sent_ns and listeners and self.arrived(Duration(seconds=self._patience)):
            self._sent_ns = 0  # from here on it is they who count
        elif self._sent_ns:
            if listeners == 1:  # else another may have got it
                self._node.dropped(f'capture {self._sent_ns}: the subscriber of {self._name} did '
                                   'not get it before the next was published')
            self._sent_ns, self._patience = next_ns, _AGAIN
        self._listeners = listeners

    def _others(self) -> int:
        """The number of subscriptions without those that get the values by reference."""
        listening = self._node.get_subscriptions_info_by_topic(self._topic)
        names = [f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in listening]
        for name in self._node.bus.subscribers(self._topic):
            if name in names:  # once: a node elsewhere may have the same name
                names.remove(name)
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

    def log_once(way: str) -> None:
        if way not in ways:
            ways.add(way)
            node.get_logger().info(f'{topic} comes {way}')

    def missed(count: int) -> None:
        if each_a_capture and count:
            node.dropped(f'{count} of {topic}: newer came before they were taken', count)

    def received(cdr: bytes) -> None:
        value = read(message_from(cdr, type_name(kind)))
        if not direct.is_duplicate(value.header.stamp_ns):
            log_once('as messages')
            callback(value)

    def woken() -> None:
        with node.watched(topic):
            values, replaced = direct.take()
            node.heard.add(subscription.topic_name)
            missed(replaced)
            for value in values:
                log_once('by reference, from a node of this process')
                callback(value)

    # What is handed over may be sent to others too, and so come twice: one of the two counts.
    subscription = node.subscribe(kind, topic, received, qos, raw=True,
                                  missed=lambda count: missed(
                                      0 if announced or direct.received_any else count),
                                  scope=scope)
    bell = node.create_guard_condition(woken)
    scope.callback(node.destroy_guard_condition, bell)
    direct = scope.enter_context(node.bus.subscribed(
        node.resolve_topic_name(topic), node.get_fully_qualified_name(), bell.trigger))
    return subscription
