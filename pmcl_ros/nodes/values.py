"""Publishers and subscriptions of values: by reference in the process, as messages elsewhere."""

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import Float32MultiArray

from pmcl_ros.conversions import Buffer, multi_array_from
from pmcl_ros.header import Header
from pmcl_ros.nodes.base import StageNode


class Stamped(Protocol):
    """A value of one capture."""

    @property
    def header(self) -> Header:
        """Which capture."""


T = TypeVar('T', bound=Stamped)


class ValuePublisher(Generic[T]):
    """Hands each value to those who take it in this process, and sends it to all others.

    For `set_up` of a node, whose health counts what went which way. write: makes the message, in
    the buffer.
    """

    def __init__(self, node: StageNode, kind: type, topic: str, qos: QoSProfile,
                 write: Callable[[T, Buffer], object]) -> None:
        self._node, self._write, self._buffer = node, write, Buffer()
        self._publisher = node.publisher(kind, topic, qos)
        self._name, self._topic = topic, node.resolve_topic_name(topic)

    def wanted(self) -> bool:
        """Whether anybody listens, as far as is known."""
        return self._publisher.get_subscription_count() > 0

    def publish(self, value: T) -> None:
        """Hand over, then send where somebody listens who is not handed it."""
        sent = self._others() > 0
        if self._node.hand_over.give(self._topic, value, value.header.stamp_ns, sent):
            self._node.health.count(f'{self._name} handed over')
        if sent:
            self._publisher.publish(self._write(value, self._buffer))
            self._node.health.count(f'{self._name} sent')

    def _others(self) -> int:
        """Subscriptions but those of the takers, which are there for other publishers."""
        listening = self._node.get_subscriptions_info_by_topic(self._topic)
        names = [f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in listening]
        for taker in self._node.hand_over.takers(self._topic):
            if taker in names:  # once: a node elsewhere may have the same name
                names.remove(taker)
        return len(names)


def subscribe_value(node: StageNode, topic: str, read: Callable[[Float32MultiArray], T],
                    callback: Callable[[T], None], qos: QoSProfile) -> Subscription:
    """As `node.subscribe`, for `start` of a node, to values: `read` makes them of messages."""
    ways: set[str] = set()

    def tell(way: str) -> None:
        if way not in ways:
            ways.add(way)
            node.get_logger().info(f'{topic} comes {way}')

    def received(cdr: bytes) -> None:
        value = read(multi_array_from(cdr))
        if not taker.had(value.header.stamp_ns):
            tell('as messages')
            callback(value)

    def woken() -> None:
        with node.watched(topic):
            for value in taker.take():
                tell('by reference, from a node of this process')
                callback(value)

    subscription = node.subscribe(Float32MultiArray, topic, received, qos, raw=True)
    bell = node.create_guard_condition(woken)
    node.active.callback(node.destroy_guard_condition, bell)
    taker = node.active.enter_context(node.hand_over.taking(
        node.resolve_topic_name(topic), node.get_fully_qualified_name(), bell.trigger))
    return subscription
