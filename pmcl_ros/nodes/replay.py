"""Plays a bag: publishes its messages as they were recorded, when somebody listens."""

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from importlib import import_module

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from rosbags.interfaces import Qos

from pmcl_ros.bags import Recorded, Topic, read, topics
from pmcl_ros.errors import BagError, PmclError
from pmcl_ros.nodes.running import pause, ros


class Player:
    """Publishes recorded messages under their topics' names, relative to the node's namespace."""

    def __init__(self, node: Node, topics: Iterable[Topic]) -> None:
        self._publishers = {each.name: node.create_publisher(
            _message_type(each.type), each.name.lstrip('/'), _profile(each.qos))
            for each in topics}

    def wait_for_subscribers(self, count: int, timeout: float) -> None:
        """Return once every topic has `count` subscribers; BagError names those that have not."""
        deadline = time.monotonic() + timeout
        while missing := [publisher.topic_name for publisher in self._publishers.values()
                          if publisher.get_subscription_count() < count]:
            if time.monotonic() > deadline:
                raise BagError(f'fewer than {count} subscribers to {", ".join(missing)} after '
                               f'{timeout:g} s; are the nodes active?')
            pause(0.05)

    def play(self, messages: Iterable[Recorded], rate: float) -> None:
        """Publish all, `rate` times as fast as it was recorded, and wait until all has arrived."""
        start, first = time.monotonic(), None
        for number, each in enumerate(messages, 1):
            first = each.time_ns if first is None else first
            pause(start + (each.time_ns - first) * 1e-9 / rate - time.monotonic())
            self._publishers[each.topic].publish(each.cdr)
            sys.stderr.write(f'{number} {each.topic} {len(each.cdr)} bytes\n')
        for publisher in self._publishers.values():
            if not publisher.wait_for_all_acked(Duration(seconds=10)):
                raise BagError(f'the last message of {publisher.topic_name} did not arrive')


def _message_type(name: str) -> type:
    package, _, kind = name.split('/')
    try:
        return getattr(import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError):
        raise BagError(f'message type {name} is not installed') from None


def _profile(qos: Qos) -> QoSProfile:
    return QoSProfile(depth=max(qos.depth, 1), history=HistoryPolicy[qos.history.name],
                      reliability=ReliabilityPolicy[qos.reliability.name],
                      durability=DurabilityPolicy[qos.durability.name])


def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    given = list(sys.argv if args is None else args)
    parser = argparse.ArgumentParser(prog='pmcl_replay', description=__doc__)
    parser.add_argument('bag', help='folder of the bag')
    parser.add_argument('--rate', type=float, default=1.0, help='times as fast as recorded')
    parser.add_argument('--subscribers', type=int, default=1,
                        help='subscribers to wait for, of each topic')
    parser.add_argument('--timeout', type=float, default=60.0, help='for them to come [s]')
    parser.add_argument('--topic', action='append', metavar='T', help='play only this topic')
    options = parser.parse_args(remove_ros_args(given)[1:])
    if options.rate <= 0:
        parser.error(f'--rate must be positive, not {options.rate}')
    try:
        found = {each.name: each for each in topics(options.bag)}
        chosen = {name: found[name] for name in options.topic or found if name in found}
        if not chosen:
            raise BagError(f'nothing to play in {options.bag}: it holds {", ".join(found)}')
        with ros(given):
            player = Player(Node('pmcl_replay'), chosen.values())
            player.wait_for_subscribers(options.subscribers, options.timeout)
            player.play((each for each in read(options.bag) if each.topic in chosen),
                        options.rate)
    except PmclError as error:
        sys.stderr.write(f'pmcl_replay: {error}\n')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
