"""The player publishes what was recorded, byte for byte, when somebody listens."""

import re
import time

import pytest
from harness import ROOT, Process
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from pmcl_ros import bags
from pmcl_ros.nodes.base import BIG, LATCHED

REPLAY = 'pmcl_ros.nodes.replay'


@pytest.fixture
def bag(tmp_path):
    """Three messages in half a second, of lengths that the transport need not pad."""
    cdr = [serialize_message(String(data=text)) for text in ('one', 'two', 'six')]
    bags.record(tmp_path / 'bag', [
        bags.Recorded('/a', 'std_msgs/msg/String', 0, cdr[0], bags.LATCHED),
        bags.Recorded('/b', 'std_msgs/msg/String', 100_000_000, cdr[1]),
        bags.Recorded('/b', 'std_msgs/msg/String', 500_000_000, cdr[2])])
    return tmp_path / 'bag'


def listen(user, topic, qos):
    """As a node does that was there before the player; raw: the bytes themselves."""
    messages = []
    user.node.create_subscription(
        String, topic, lambda cdr: messages.append((time.monotonic(), cdr)), qos, raw=True)
    return messages


@pytest.mark.parametrize(('rate', 'shortest', 'longest'), [(1, 0.35, 2), (20, 0, 0.3)])
def test_messages_come_in_order_and_at_the_rate(tmp_path, user, bag, rate, shortest, longest):
    first, second = listen(user, 'a', LATCHED), listen(user, 'b', BIG)
    with Process(tmp_path, REPLAY, bag, '--rate', rate):
        user.wait(lambda: len(second) == 2, 'the messages')
    expected = [each.cdr for each in bags.read(bag)]
    assert [cdr for _, cdr in (*first, *second)] == expected
    assert shortest < second[1][0] - second[0][0] < longest


def test_a_topic_can_be_chosen(tmp_path, user, bag):
    messages = listen(user, 'b', BIG)
    with Process(tmp_path, REPLAY, bag, '--topic', '/b') as player:
        user.wait(lambda: len(messages) == 2, 'the messages')
        user.wait(lambda: not player.alive(), 'the end')
    assert '/a' not in player.log


@pytest.mark.parametrize(('arguments', 'status', 'reason'), [
    (['BAG', '--timeout', 0.2], 1, 'fewer than 1 subscribers to /a, /b after 0.2 s'),
    (['BAG', '--topic', '/c'], 1, 'nothing to play in .*: it holds /a, /b'),
    (['BAG', '--rate', 0], 2, '--rate must be positive'),
    ([ROOT, '--rate', 1], 1, 'cannot read the bag'),
])
def test_what_cannot_be_played_is_told(tmp_path, bag, arguments, status, reason):
    player = Process(tmp_path, REPLAY, *(bag if each == 'BAG' else each for each in arguments))
    assert player.popen.wait(60) == status
    assert re.search(reason, player.log), player.log
