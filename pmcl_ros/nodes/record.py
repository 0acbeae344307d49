"""Records a bag of what the nodes publish, until a signal comes."""

import argparse
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.utilities import remove_ros_args
from rosbags.interfaces import Qos

from pmcl_ros.messages import bags
from pmcl_ros.messages.bags import BagWriter, Recorded
from pmcl_ros.messages.types import message_class
from pmcl_ros.nodes.graph import BIG, PRESETS, TOPICS, TRANSFORMS, Quality, TopicEntry
from pmcl_ros.nodes.runtime.running import Interrupted, pause, ros
from pmcl_ros.runtime.errors import BagError, PmclError

_RECORDABLE = (*TOPICS, *TRANSFORMS)
_REST = 5.0  # s: after a signal, for what waits to be written while more may be coming
_ROOM = 4  # big messages that may wait to be written: a capture's come at once


class Recorder:
    """Writes all that comes on some topics, as it came over the wire, in the order of arrival.

    It is reliable: what is lost between a publisher and here is what the publisher's own history
    has no room for. Of a publisher that offers no more, a camera say, it takes the best effort.
    """

    def __init__(self, node: Node, topics: Sequence[TopicEntry], writer: BagWriter) -> None:
        self._node, self._writer = node, writer
        self.messages = self._bytes = 0  # that were written
        self._subscriptions = {each: self._subscribe(each, _profile(each.quality))
                               for each in topics}

    def _subscribe(self, topic: TopicEntry, profile: QoSProfile) -> Subscription:
        return self._node.create_subscription(
            message_class(topic.type), topic.name, partial(self._received, topic), profile,
            raw=True, event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=partial(self._take_less, topic, profile)))

    def _take_less(self, topic: TopicEntry, profile: QoSProfile, event: Any) -> None:
        """Listen as a publisher allows that offers less."""
        if event.last_policy_kind == QoSPolicyKind.RELIABILITY:
            words, profile.reliability = 'reliable', ReliabilityPolicy.BEST_EFFORT
        elif event.last_policy_kind == QoSPolicyKind.DURABILITY:
            words, profile.durability = 'latched', DurabilityPolicy.VOLATILE
        else:
            return
        self._node.get_logger().warning(f'a publisher of {topic.name} is not {words}: what is '
                                        'lost of its messages is not sent again')
        self._node.destroy_subscription(self._subscriptions[topic])
        self._subscriptions[topic] = self._subscribe(topic, profile)

    def _received(self, topic: TopicEntry, cdr: bytes, info: dict[str, Any]) -> None:
        came = info['received_timestamp'] or self._node.get_clock().now().nanoseconds
        self._writer.write(Recorded(self._node.resolve_topic_name(topic.name), topic.type, came,
                                    cdr, _offered(topic.quality)))
        self.messages += 1
        self._bytes += len(cdr)
        self._node.get_logger().info(self.summary(), throttle_duration_sec=1.0)

    def summary(self) -> str:
        """What has been recorded."""
        return f'recorded {self.messages} messages, {self._bytes / 1e6:.1f} MB'


def _profile(quality: Quality) -> QoSProfile:
    return QoSProfile(
        depth=_ROOM if quality == BIG else quality.depth, reliability=ReliabilityPolicy.RELIABLE,
        durability=(DurabilityPolicy.TRANSIENT_LOCAL if quality.latched
                    else DurabilityPolicy.VOLATILE))


def _offered(quality: Quality) -> Qos:
    """The quality of service of a publisher, which the player offers again."""
    return (bags.LATCHED if quality.latched else bags.VOLATILE)._replace(depth=quality.depth)


def record(options: argparse.Namespace) -> None:
    """Record into a new bag until a signal or the end; BagError when nothing came."""
    names = [*PRESETS[options.preset]] if options.preset else options.topic
    chosen = [each for each in _RECORDABLE if each.name in names]
    end = time.monotonic() + options.duration
    node, executor = Node('pmcl_record'), SingleThreadedExecutor()
    topics = ', '.join(map(node.resolve_topic_name, names))  # where remaps put them
    executor.add_node(node)
    with BagWriter(options.output) as writer:
        recorder = Recorder(node, chosen, writer)
        node.get_logger().info(f'listening to {topics}')
        try:
            while time.monotonic() < end:
                pause(0)
                executor.spin_once(timeout_sec=min(0.2, max(end - time.monotonic(), 0)))
        except Interrupted:  # as every recording ends; what has come is written first
            written, end = -1, time.monotonic() + _REST
            while written < recorder.messages and time.monotonic() < end:
                written = recorder.messages
                executor.spin_once(timeout_sec=0.1)
        finally:
            executor.shutdown()
            node.destroy_node()
        if not recorder.messages:
            raise BagError(f'nothing came on {topics}: are the nodes active, in this namespace '
                           '(-r __ns:=...) and ROS_DOMAIN_ID, are topics to be remapped?')
    node.get_logger().info(f'{recorder.summary()} into {options.output}')


def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    given = list(sys.argv if args is None else args)
    parser = argparse.ArgumentParser(prog='pmcl_record', description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument('--preset', choices=list(PRESETS), help='; '.join(
        f'{name}: {", ".join(topics)}' for name, topics in PRESETS.items() if name != 'all'))
    what.add_argument('--topic', action='append', metavar='T',
                      choices=[each.name for each in _RECORDABLE], help='record this topic')
    parser.add_argument('-o', '--output', type=Path, required=True, help='folder of the new bag')
    parser.add_argument('--duration', type=float, default=float('inf'), help='end by itself [s]')
    options = parser.parse_args(remove_ros_args(given)[1:])
    if not options.duration > 0:  # nor NaN
        parser.error(f'--duration must be positive, not {options.duration}')
    try:
        with ros(given):
            record(options)
    except PmclError as error:
        sys.stderr.write(f'pmcl_record: {error}\n')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
