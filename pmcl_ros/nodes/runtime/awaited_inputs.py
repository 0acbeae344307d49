"""What a node waits for: its topics, and who publishes there, as after a slip in a remap."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.subscription import Subscription

from pmcl_ros.messages.cdr import type_name
from pmcl_ros.nodes.runtime.base import StageNode

Inputs = Sequence[Subscription]

_LOOK = 1.0  # s between two looks
_PATIENCE = 5.0  # s: for publishers to be discovered. DDS repeats lost messages every 3 s


class AwaitedInputs:
    """Tells on /diagnostics what a node waits for, until it comes; for `start` of a node.

    Silence is no fault: pictures are taken when somebody wants one. A topic that nobody publishes
    is one: after 5 s the level is WARN, and the log tells it once.

    ways: of each way to give the node its input, the subscriptions that it needs, the one that
    counts captures last; called at each look.
    """

    def __init__(self, node: StageNode, ways: Callable[[], Sequence[Inputs]]) -> None:
        self._node, self._ways = node, ways
        self._began, self._told = time.monotonic(), False
        self._met: set[str] = set()  # topics that have had a publisher, who may be gone
        self._timer = node.every(_LOOK, self._look)

    def _look(self) -> None:
        ways, heard = self._ways(), self._node.heard
        self._met |= heard | {each.topic_name for way in ways for each in way
                              if each.get_publisher_count()}
        ready = [way for way in ways if self._met.issuperset(each.topic_name for each in way)]
        if any(way[-1].topic_name in heard for way in ready):
            self._timer.cancel()
            self._node.health.came()
            return
        text = 'awaits ' + ' or '.join(
            ', '.join(f'{each.topic_name} ({publishers(self._node, each)})' for each in inputs)
            for inputs in ([way[-1:] for way in ready] or self._lacking(ways)))
        missing = not ready and time.monotonic() - self._began > _PATIENCE
        self._node.health.awaits(text, DiagnosticStatus.WARN if missing else DiagnosticStatus.OK)
        if missing and not self._told:
            self._told = True
            self._node.get_logger().warning(
                f'{text}: does its publisher run, in this namespace and ROS_DOMAIN_ID, are topics '
                'to be remapped?')

    def _lacking(self, ways: Sequence[Inputs]) -> list[Inputs]:
        """What ways lack that somebody gives a part of; else of each what it counts by."""
        lacking = [[each for each in way if each.topic_name not in self._met] for way in ways]
        return [lack for way, lack in zip(ways, lacking, strict=True) if len(lack) < len(way)] or [
            way[-1:] for way in ways]


def publishers(node: Node, subscription: Subscription) -> str:
    """How many publishers a subscription hears, and why not those that it does not hear."""
    count = subscription.get_publisher_count()
    there = () if count else node.get_publishers_info_by_topic(subscription.topic_name)
    of: Any = subscription.msg_type  # a class, which rclpy's type hints do not tell
    kind, reasons = type_name(of), set()
    for each in there:
        fits, reason = qos_check_compatible(each.qos_profile, subscription.qos_profile)
        if each.topic_type != kind:
            reasons.add(f'{each.topic_type} is not {kind}')
        elif fits == QoSCompatibility.ERROR:
            reasons.add(', '.join(part.removeprefix('ERROR: ') for part in reason.split(';')
                                  if part))
    if not reasons:
        return f'publishers: {count}'
    return f'publishers: {len(there)}, not heard: {"; ".join(sorted(reasons))}'
