"""Each capture's evidence is delivered once, or its loss is counted."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
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
        self.input = EvidenceInput(self, PmclSettings(), self.evidence.append, both=True,
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


def test_edges_come_with_the_contour_map_of_their_capture(searcher, user, small_edges, small_map):
    searcher.hand_over('dlv/edges', small_edges, 1)  # nobody has published a map yet
    assert searcher.hand_over('dlv/contour_map', small_map, 2) == 1
    settle(user)
    for stamp in (2, 3):
        searcher.hand_over('dlv/edges', small_edges, stamp)
        settle(user)
    before, second, third = searcher.evidence
    assert before.other() is None
    assert second.other().header == Header(2)
    np.testing.assert_array_equal(second.other().tensor, small_map.tensor)
    with ThreadPoolExecutor(1) as pool:  # as the thread that searches, before the map has come
        waiting = pool.submit(third.other)
        searcher.hand_over('dlv/contour_map', small_map, 3)
        user.wait(waiting.done, 'the map')
    assert waiting.result().header == Header(3)
    np.testing.assert_array_equal(third.tensor, small_edges.tensor)
    assert searcher.health.dropped == 0


def test_a_contour_map_that_does_not_come_is_waited_for_in_vain(searcher, user, small_edges,
                                                                small_map):
    for stamp in (1, 2, 3):
        searcher.hand_over('dlv/contour_map', small_map, stamp)
        settle(user)
    for stamp in (1, 3, 4):
        searcher.hand_over('dlv/edges', small_edges, stamp)
        settle(user)
    old, last, next_one = searcher.evidence
    assert old.other() is None  # too late: two captures' maps are kept
    assert last.other().header == Header(3)
    assert next_one.other() is None


@pytest.mark.parametrize('end', [lambda node: node.input.forget(),
                                 lambda node: node.trigger_deactivate()])
def test_a_volume_that_waits_when_the_input_ends_is_dropped(
        searcher, user, small_volume, capfd, end):
    searcher.hand_over('dlv', small_volume, 5)
    settle(user)
    end(searcher)
    assert (searcher.evidence, searcher.health.dropped) == ([], 1)
    assert 'dropped capture 5: the node was reset or deactivated' in capfd.readouterr().err
