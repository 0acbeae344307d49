"""Plays a bag: publishes its messages as they were recorded, when somebody listens."""

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosReliability

from pmcl_ros.messages.bags import Recorded, Topic, read, topics
from pmcl_ros.messages.types import message_class
from pmcl_ros.nodes.graph import PRESETS
from pmcl_ros.nodes.runtime.running import pause, ros
from pmcl_ros.runtime.errors import BagError, PmclError

if TYPE_CHECKING:
    from pmcl_ros.nodes.transport.lockstep_player import LockstepPlayer

RCLError = rclpy_implementation.RCLError
_DEEPEST = 1000  # messages of a history: with more, DDS refuses to make the publisher
_ROUND = 1.0  # s: a bag of one capture would begin again as fast as DDS can take it
_PATIENCE = 30.0  # s: for messages to arrive; DDS gives up who has been silent for 20


class Player:
    """Publishes recorded messages under their topics' names, relative to the node's namespace."""

    def __init__(self, node: Node, topics: Iterable[Topic]) -> None:
        self._logger, topics = node.get_logger(), list(topics)
        self._total = sum(each.messages for each in topics)
        self._lines = {each.name: _Line(node, each) for each in topics}

    def wait_for_subscribers(self, count: int, timeout: float) -> None:
        """Return once every topic has `count` subscribers; BagError names those that have not.

        Of dlv, dlv/edges and dlv/contour_map one is enough: pmcl_node does not subscribe to all.
        """
        deadline = time.monotonic() + timeout
        while missing := self._missing(count):
            if time.monotonic() > deadline:
                raise BagError(f'fewer than {count} subscribers to {", ".join(missing)} after '
                               f'{timeout:g} s; are the nodes active?')
            pause(0.05)

    def _missing(self, count: int) -> list[str]:
        heard = {line.name for line in self._lines.values() if line.subscribers() >= count}
        for dlv in [each.name for each in self._lines.values() if each.name.endswith('/dlv')]:
            kinds = {dlv, f'{dlv}/edges', f'{dlv}/contour_map'}
            if heard & kinds:
                heard |= kinds
        return [line.name for line in self._lines.values() if line.name not in heard]

    def play(self, messages: Iterable[Recorded], rate: float,
             lockstep: 'LockstepPlayer | None' = None) -> None:
        """Publish all, `rate` times as fast as it was recorded, and wait until all has arrived.

        The time counts from when the first has been published. What a subscriber keeps of
        messages that come faster than it takes them is its own choice: the newest, by its depth.
        Messages are taken one by one, as they are due; those of a capture not before `lockstep`
        lets them.
        """
        start, first_ns, number, into = time.monotonic(), 0, 0, 0.0

        def position() -> str:
            return f'{number} of {self._total} messages, {into:.1f} s into the bag'

        for number, each in enumerate(messages, 1):
            if lockstep is not None:
                lockstep.before(each)
            if number > 1:
                into = (each.time_ns - first_ns) * 1e-9
                pause(start + into / rate - time.monotonic())
            self._lines[each.topic].publish(each.cdr)
            if number == 1:
                start, first_ns = time.monotonic(), each.time_ns
            self._logger.info(position(), throttle_duration_sec=1.0)
        for line in self._lines.values():
            line.wait_until_arrived()
        if lockstep is not None:
            lockstep.wait()
        self._logger.info(f'played {position()}')


class _Line:
    """A publisher that overwrites nothing in its history before it has arrived.

    Reliable is not enough: a history that keeps the last one drops what a subscriber has been
    found for but has not got, as it may know of the publisher a moment later than that of it.
    """

    def __init__(self, node: Node, topic: Topic) -> None:
        profile = _profile(topic.qos)
        kind = message_class(topic.type)
        try:
            self._publisher = node.create_publisher(kind, topic.name.lstrip('/'), profile)
        except (InvalidTopicNameException, RCLError, ValueError, TypeError) as error:
            raise BagError(f'{topic.name} of {topic.type} cannot be played: {error}') from None
        self._room = profile.depth if profile.history == HistoryPolicy.KEEP_LAST else sys.maxsize
        self._kept = 0  # not known to have arrived

    @property
    def name(self) -> str:
        """The topic's, with the namespace."""
        return str(self._publisher.topic_name)

    def subscribers(self) -> int:
        """How many have been found."""
        return int(self._publisher.get_subscription_count())

    def publish(self, cdr: bytes) -> None:
        """Publish; return once there is room for the next."""
        self._publisher.publish(cdr)
        self._kept += 1
        # Not sooner: DDS asks for acknowledgement at once only where a history is full, else every
        # three seconds.
        if self._kept == self._room:
            self.wait_until_arrived()

    def wait_until_arrived(self) -> None:
        """Return once all is in every subscriber's history, taken or not; else BagError."""
        deadline = time.monotonic() + _PATIENCE
        while not self._publisher.wait_for_all_acked(Duration(seconds=0.1)):
            pause(0)
            if time.monotonic() > deadline:
                raise BagError(f'a message of {self.name} did not arrive at every subscriber '
                               f'within {_PATIENCE:g} s')
        self._kept = 0


def _profile(qos: Qos) -> QoSProfile:
    """What was offered; of what was not known when it was recorded, the safest."""
    keep_all = qos.history == QosHistory.KEEP_ALL
    best_effort = qos.reliability == QosReliability.BEST_EFFORT
    latched = qos.durability == QosDurability.TRANSIENT_LOCAL
    return QoSProfile(
        depth=min(max(qos.depth, 1), _DEEPEST),
        history=HistoryPolicy.KEEP_ALL if keep_all else HistoryPolicy.KEEP_LAST,
        reliability=(ReliabilityPolicy.BEST_EFFORT if best_effort
                     else ReliabilityPolicy.RELIABLE),
        durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE))


def _chosen(options: argparse.Namespace) -> dict[str, Topic]:
    """The topics of the bag that are to be played; BagError where there are none."""
    found = {each.name: each for each in topics(options.bag)}
    if unknown := [each for each in options.topic if each not in found]:
        raise BagError(f'{options.bag} has no topic {", ".join(unknown)}: it holds '
                       f'{", ".join(found)}')
    if not options.topic and options.preset is None:
        chosen = found
    else:
        # in whatever namespace it was recorded
        of_stage = tuple(f'/{each.lstrip("/")}' for each in PRESETS.get(options.preset, ()))
        chosen = {name: each for name, each in found.items()
                  if name in options.topic or name.endswith(of_stage)}
    if not chosen:
        raise BagError(f'nothing to play in {options.bag}: it holds {", ".join(found)}')
    return chosen


def replay(node: Node, options: argparse.Namespace, chosen: dict[str, Topic]) -> None:
    """Play topics of a bag, once or for ever; BagError where nobody listens or answers."""
    lockstep = None
    if options.in_step:  # its import of numba takes longer than the start of the rest
        from pmcl_ros.nodes.transport.lockstep_player import LockstepPlayer
        lockstep = LockstepPlayer(node, chosen.values(), options.patience)
    player = Player(node, chosen.values())
    player.wait_for_subscribers(options.subscribers, options.timeout)
    if lockstep is not None:
        lockstep.wait_for_answerer(options.timeout)
    while True:
        began = time.monotonic()
        player.play(read(options.bag, chosen), options.rate, lockstep)
        if not options.loop:
            return
        pause(began + _ROUND - time.monotonic())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='pmcl_replay', description=__doc__)
    parser.add_argument('bag', help='folder of the bag')
    parser.add_argument('--rate', type=float, default=1.0, help='times as fast as recorded')
    parser.add_argument('--subscribers', type=int, default=1,
                        help='subscribers to wait for, of each topic')
    parser.add_argument('--timeout', type=float, default=60.0, help='for them to come [s]')
    parser.add_argument('--in-step', action='store_true',
                        help='play a capture when pmcl_node has published the result of the one '
                        'before on objects: none is dropped, however slow the nodes are')
    parser.add_argument('--patience', type=float, default=300.0,
                        help='in step: for the result of a capture; the first one may have to '
                        'wait until the nodes are compiled [s]')
    parser.add_argument('--topic', action='append', default=[], metavar='T',
                        help='play only this topic')
    parser.add_argument('--preset', choices=list(PRESETS),
                        help='play only the topics of this stage, as of pmcl_record')
    parser.add_argument('--loop', action='store_true', help='begin again at the end')
    return parser


def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    given = list(sys.argv if args is None else args)
    parser = _parser()
    options = parser.parse_args(remove_ros_args(given)[1:])
    if not options.rate > 0:  # nor NaN
        parser.error(f'--rate must be positive, not {options.rate}')
    try:
        chosen = _chosen(options)
        with ros(given):
            replay(Node('pmcl_replay'), options, chosen)
    except PmclError as error:
        sys.stderr.write(f'pmcl_replay: {error}\n')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
