"""Each capture's evidence is delivered once, or its loss is counted."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_msgs.msg import Float32MultiArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.nodes.evidence_input import EvidenceInput
from pmcl_ros.nodes.pmcl_node import PmclNode
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
                                   discovery=3600.0, patience=60.0)

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


@pytest.fixture
def maps(searcher, user):
    """Somebody publishes contour maps."""
    publisher = user.node.create_publisher(Float32MultiArray, 'dlv/contour_map', BIG)
    user.wait(lambda: searcher.count_publishers('/dlv/contour_map')
              and publisher.get_subscription_count(), 'the subscription to dlv/contour_map')
    settle(user)


def given(searcher, user, topic, value, *stamps):
    for stamp in stamps:
        assert searcher.hand_over(topic, value, stamp) == 1
        settle(user)


def test_edges_come_with_the_contour_map_of_their_capture(searcher, user, maps, small_edges,
                                                          small_map):
    given(searcher, user, 'dlv/contour_map', small_map, 2)
    given(searcher, user, 'dlv/edges', small_edges, 2, 3)
    second, third = searcher.evidence
    assert second.other().header == Header(2)
    np.testing.assert_array_equal(second.other().tensor, small_map.tensor)
    with ThreadPoolExecutor(1) as pool:  # as the thread that searches, before the map has come
        waiting = pool.submit(third.other)
        searcher.hand_over('dlv/contour_map', small_map, 3)
        user.wait(waiting.done, 'the map')
    assert waiting.result().header == Header(3)
    np.testing.assert_array_equal(third.tensor, small_edges.tensor)
    assert searcher.health.dropped == 0


def test_where_nobody_publishes_maps_edges_come_alone(searcher, user, small_edges):
    given(searcher, user, 'dlv/edges', small_edges, 1)
    alone, = searcher.evidence
    assert alone.other is None


def test_no_search_waits_for_a_map_that_cannot_come(searcher, user, maps, small_edges, small_map):
    given(searcher, user, 'dlv/edges', small_edges, 1, 9)
    given(searcher, user, 'dlv/contour_map', small_map, 2)
    overtaken, next_one = searcher.evidence
    with ThreadPoolExecutor(2) as pool:
        late, waiting = pool.submit(overtaken.other), pool.submit(next_one.other)
        user.wait(late.done, 'the end of the wait: the map of a later capture has come')
        assert not waiting.done()
        searcher.input.wait_no_more()
        user.wait(waiting.done, 'the end of all waiting')
    assert (late.result(), waiting.result()) == (None, None)
    searcher.input.forget()
    given(searcher, user, 'dlv/contour_map', small_map, 9)
    assert next_one.other().header == Header(9)


def test_a_bag_that_is_played_again_has_its_maps_waited_for(searcher, user, maps, small_edges,
                                                            small_map):
    given(searcher, user, 'dlv/edges', small_edges, 5, 9)
    given(searcher, user, 'dlv/contour_map', small_map, 5, 9)
    given(searcher, user, 'dlv/edges', small_edges, 4)
    again = searcher.evidence[-1]
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(again.other)
        settle(user)
        assert not waiting.done()
        searcher.hand_over('dlv/contour_map', small_map, 4)
        user.wait(waiting.done, 'the map')
    assert waiting.result().header == Header(4)


@pytest.mark.parametrize(('changes', 'both'), [
    ({}, True), ({'tracking': 'constant_pose'}, False), ({'evidence': 'edges'}, False),
    ({'mode': 'faithful'}, False)])
def test_pmcl_node_reads_contour_maps_beside_edges_of_one_untracked_object(parameters, changes,
                                                                          both):
    context = Context()
    rclpy.init(context=context)
    values = parameters['pmcl_node'] | changes
    node = PmclNode(context=context, parameter_overrides=[
        Parameter(name, value=value) for name, value in values.items()])
    assert node.trigger_configure() == node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    read = {each.topic_name for each in node.subscriptions}
    node.close()
    rclpy.shutdown(context=context)
    assert ('/dlv/contour_map' in read) == both
    assert ('/dlv/edges' in read) == (changes.get('mode') != 'faithful')


@pytest.mark.parametrize('end', [lambda node: node.input.forget(),
                                 lambda node: node.trigger_deactivate()])
def test_a_volume_that_waits_when_the_input_ends_is_dropped(
        searcher, user, small_volume, capfd, end):
    searcher.hand_over('dlv', small_volume, 5)
    settle(user)
    end(searcher)
    assert (searcher.evidence, searcher.health.dropped) == ([], 1)
    assert 'dropped capture 5: the node was reset or deactivated' in capfd.readouterr().err
