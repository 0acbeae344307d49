"""The object's frame on /tf where tf2_msgs is, and a clear word where it is not."""

import sys
from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from generated_interfaces import importable
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.pose import estimate_to_messages, estimate_to_transform
from pmcl_ros.pmcl.estimate import PoseEstimate

# What tf2's listeners subscribe with, and who asks for what was sent before.
VOLATILE, LATCHED = (QoSProfile(depth=100, durability=each) for each in (
    DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL))


@pytest.fixture
def estimate():
    pose = np.array([[0, -1, 0, 0.1], [1, 0, 0, -0.2], [0, 0, 1, 0.7], [0, 0, 0, 1.0]])
    return PoseEstimate(Header(1_700_000_000_000_000_007, 'lytro_optical_frame'), pose,
                        np.eye(6), pose[None], np.zeros(1), 1.0, False, 'default')


def test_a_transform_is_the_pose(estimate):
    transform = estimate_to_transform(estimate, 'glass')
    assert transform.child_frame_id == 'glass'
    pose = estimate_to_messages(estimate).pose
    assert transform.header == pose.header
    assert transform.transform.rotation == pose.pose.orientation
    for axis in 'xyz':
        assert (getattr(transform.transform.translation, axis)
                == getattr(pose.pose.position, axis))


@pytest.fixture(scope='module')
def tf_message(tmp_path_factory):
    with importable(tmp_path_factory.mktemp('tf2_msgs'), 'tf2_msgs', {
            'msg/TFMessage.msg': 'geometry_msgs/TransformStamped[] transforms\n'}):
        from tf2_msgs.msg import TFMessage
        yield TFMessage


def test_without_tf2_msgs_the_node_says_what_to_install(make_pmcl_node, monkeypatch, capfd):
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)  # as if it were not installed
    node = make_pmcl_node(broadcast_tf=True)
    assert node.trigger_configure() == Result.FAILURE
    error = capfd.readouterr().err
    assert "parameter 'broadcast_tf' is true, but message type tf2_msgs/msg/TFMessage is" in error
    assert 'ros-jazzy-tf2-msgs' in error
    assert 'Traceback' not in error
    node.set_parameters([Parameter('broadcast_tf', value=False)])
    assert node.trigger_configure() == Result.SUCCESS


@pytest.mark.parametrize(('changes', 'child', 'lost'), [
    ({}, 'wine_glass', False), ({'object_frame': 'glass'}, 'glass', True)])
def test_listeners_that_come_later_get_the_last_transform_until_there_is_none(
        make_pmcl_node, user, tf_message, estimate, changes, child, lost):
    node = make_pmcl_node(broadcast_tf=True, **changes)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    user.others.append(executor)
    assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
    last = replace(estimate, header=replace(estimate.header, stamp_ns=1_700_000_001_000_000_007))
    expected = [tf_message(transforms=[estimate_to_transform(each, child)])
                for each in (estimate, last)]
    before = []
    user.node.create_subscription(tf_message, '/tf', before.append, VOLATILE)
    user.wait(lambda: user.node.count_publishers('/tf') and node.count_subscribers('/tf'), '/tf')
    for each, transform in zip((estimate, last), expected, strict=True):
        node.objects.frames[0].broadcast(each)
        user.wait(lambda transform=transform: transform in before, 'a transform')
    assert _distinct(before) == expected
    for qos in (VOLATILE, LATCHED):
        after = []
        user.node.create_subscription(tf_message, '/tf', after.append, qos)
        user.wait(lambda after=after: expected[1] in after, 'the last transform')
        assert _distinct(after) == expected[1:]
    if lost:
        node.objects.frames[0].broadcast(replace(last, lost=True))
    else:
        node.objects.frames[0].forget()  # as at ~/reset
    # What is still under way to this participant comes to its new subscriptions too.
    user.wait(lambda: not before[-1].transforms, 'what has no transforms')
    after = []
    user.node.create_subscription(tf_message, '/tf', after.append, LATCHED)
    user.wait(lambda: after, 'what is latched')
    assert not any(each.transforms for each in after)
    user.others.clear()
    executor.shutdown()


def _distinct(messages):
    """Without repetitions: who comes while one is sent may get it twice."""
    return [message for message, _ in groupby(messages)]
