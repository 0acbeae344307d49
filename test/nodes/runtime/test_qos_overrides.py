"""Quality of service can be overridden by parameters, within reason."""

import copy

import pytest
import rclpy
from rclpy.context import Context
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, ReliabilityPolicy
from std_msgs.msg import String

from pmcl_ros.nodes.runtime.base import BIG, SMALL, StageNode
from pmcl_ros.runtime.settings import Settings


class Relay(StageNode):
    """A big topic in, a small one out."""

    name, settings_class = 'relay', Settings

    def set_up(self, _):
        self.out = self.publisher(String, 'out', SMALL)

    def start(self):
        self.into = self.subscribe(String, 'in', lambda _: None, BIG)


@pytest.fixture
def make():
    """A function overrides -> a node."""
    context = Context()
    rclpy.init(context=context)
    nodes = []

    def make(overrides):
        nodes.append(Relay(context=context, parameter_overrides=[
            Parameter(f'qos_overrides./{name}', value=value)
            for name, value in overrides.items()]))
        return nodes[-1]

    yield make
    for each in nodes:
        each.close()
    rclpy.shutdown(context=context)


def test_what_is_given_is_used_whenever_the_node_is_configured(make):
    big, small = copy.copy(BIG), copy.copy(SMALL)
    node = make({'out.publisher.depth': 3, 'out.publisher.reliability': 'best_effort',
                 'in.subscription.history': 'keep_last', 'in.subscription.depth': 2})
    for _ in range(2):
        assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
        out, into = node.out.qos_profile, node.into.qos_profile
        assert (out.depth, out.reliability) == (3, ReliabilityPolicy.BEST_EFFORT)
        assert (into.depth, into.reliability) == (2, ReliabilityPolicy.RELIABLE)
        assert node.trigger_deactivate() == node.trigger_cleanup() == Result.SUCCESS
    assert (big, small) == (BIG, SMALL)  # the next node's are as they were


def test_without_overrides_all_is_as_the_node_wants_it(make):
    node = make({})
    node.trigger_configure()
    node.trigger_activate()
    assert (node.out.qos_profile.depth, node.into.qos_profile.depth) == (10, 1)
    described, = node.describe_parameters(['qos_overrides./in.subscription.depth'])
    assert described.read_only


@pytest.mark.parametrize(('name', 'value', 'reason'), [
    ('out.publisher.reliability', 'besteffort', 'besteffort'),
    ('out.publisher.depth', 0, 'depth 0 keeps nothing: it must be 1 or more'),
    ('out.publisher.depth', 'many', "expecting type 'INTEGER'"),
])
@pytest.mark.filterwarnings('ignore:A zero depth')
def test_what_is_no_quality_of_service_is_refused_in_a_line(make, capfd, name, value, reason):
    node = make({name: value})
    assert node.trigger_configure() == Result.FAILURE
    error = capfd.readouterr().err
    assert 'cannot configure: out: ' in error
    assert reason in error
    assert 'Traceback' not in error


@pytest.mark.parametrize(('name', 'value', 'warning'), [
    ('in.subscription.reliability', 'best_effort', 'most of its messages'),
    ('in.subscription.history', 'keep_all', 'may fill the memory'),
    ('on.subscription.depth', 2, 'did you mean qos_overrides./in.subscription.depth?'),
])
def test_what_is_unwise_is_done_with_a_warning(make, capfd, name, value, warning):
    node = make({name: value})
    assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
    assert warning in capfd.readouterr().err
    wanted = {'best_effort': ReliabilityPolicy.BEST_EFFORT, 'keep_all': HistoryPolicy.KEEP_ALL}
    assert value in (node.into.qos_profile.reliability.name.lower(),
                     node.into.qos_profile.history.name.lower()) or value not in wanted
