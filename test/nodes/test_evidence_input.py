"""Each capture's evidence is delivered once, or its loss is counted."""

from dataclasses import replace

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Float32MultiArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.nodes.evidence_input import EvidenceInput
from pmcl_ros.nodes.runtime.base import BIG, StageNode
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.settings import Settings


class Searcher(StageNode):
    """Keeps the evidence that comes."""

    name, settings_class = 'searcher', Settings

    def set_up(self, _):
        self.evidence = []

    def start(self):
        self.input = EvidenceInput(self, PmclSettings(), self.evidence.append,
                                   discovery=3600.0)

    def hand_over(self, topic, value, stamp):
        """By reference: the number of subscriptions that it reaches."""
        value = replace(value, header=Header(stamp))
        return self.bus.publish(self.resolve_topic_name(topic), value, stamp, sent=False)


def settle(user):
    """Let all callbacks run that are due: a spin runs one."""
    for _ in range(10):
        user.spin()


@pytest.fixture
def searcher(user):
    """An active node that has subscribed to dlv, as nobody publishes dlv/edges."""
    context = Context()
    rclpy.init(context=context)
    node, executor = Searcher(context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    user.others.append(executor)
    node.trigger_configure()
    node.trigger_activate()
    publisher = user.node.create_publisher(Float32MultiArray, 'dlv', BIG)
    user.wait(publisher.get_subscription_count, 'the subscription to dlv')
    yield node
    user.others.clear()
    executor.shutdown()
    node.close()
    rclpy.shutdown(context=context)


def test_edges_replace_the_volume_that_waits_and_end_the_subscription(
        searcher, user, small_volume, small_edges, capfd):
    for stamp in (1, 2):
        assert searcher.hand_over('dlv', small_volume, stamp) == 1
        settle(user)
    assert searcher.hand_over('dlv/edges', small_edges, 2) == 1
    user.wait(lambda: searcher.evidence, 'the edges')
    assert searcher.hand_over('dlv', small_volume, 1) == 0  # too late: 2 has been delivered
    assert [(type(each), each.header.stamp_ns) for each in searcher.evidence] == [
        (type(small_edges), 2)]
    assert searcher.health.dropped == 1
    assert 'dropped capture 1: no dlv/edges came with it' in capfd.readouterr().err


@pytest.mark.parametrize('end', [lambda node: node.input.forget(),
                                 lambda node: node.trigger_deactivate()])
def test_a_volume_that_waits_when_the_input_ends_is_dropped(
        searcher, user, small_volume, capfd, end):
    searcher.hand_over('dlv', small_volume, 5)
    settle(user)
    end(searcher)
    assert (searcher.evidence, searcher.health.dropped) == ([], 1)
    assert 'dropped capture 5: the node was reset or deactivated' in capfd.readouterr().err
