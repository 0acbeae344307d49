"""The object's frame on /tf where tf2_ros is, and a clear word where it is not."""

import importlib.util

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.pose import estimate_to_messages, estimate_to_transform
from pmcl_ros.nodes.pmcl_node import PmclNode
from pmcl_ros.pmcl.estimate import PoseEstimate

INSTALLED = importlib.util.find_spec('tf2_ros') is not None


@pytest.fixture
def make(parameters):
    """A function changes -> a pmcl_node with these parameters."""
    context = Context()
    rclpy.init(context=context)
    nodes = []

    def make(**changes):
        nodes.append(PmclNode(context=context, parameter_overrides=[
            Parameter(name, value=value)
            for name, value in (parameters['pmcl_node'] | changes).items()]))
        return nodes[-1]

    yield make
    for each in nodes:
        each.close()
    rclpy.shutdown(context=context)


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


@pytest.mark.skipif(INSTALLED, reason='tf2_ros is there')
def test_without_tf2_ros_the_node_says_what_to_install(make, capfd):
    node = make(broadcast_tf=True)
    assert node.trigger_configure() == Result.FAILURE
    error = capfd.readouterr().err
    assert "parameter 'broadcast_tf' is true, but tf2_ros cannot be imported" in error
    assert 'ros-jazzy-tf2-ros-py' in error
    assert 'Traceback' not in error
    node.set_parameters([Parameter('broadcast_tf', value=False)])
    assert node.trigger_configure() == Result.SUCCESS


@pytest.mark.skipif(not INSTALLED, reason='tf2_ros is part of a full ROS, not on PyPI')
@pytest.mark.parametrize(('changes', 'child'), [({}, 'wine_glass'),
                                                ({'object_frame': 'glass'}, 'glass')])
def test_the_frame_of_the_object_is_broadcast(make, user, estimate, changes, child):
    from tf2_msgs.msg import TFMessage
    node = make(broadcast_tf=True, **changes)
    assert node.trigger_configure() == Result.SUCCESS
    heard = []
    user.node.create_subscription(TFMessage, '/tf', heard.append, 10)
    user.wait(lambda: user.node.count_publishers('/tf') and node.count_subscribers('/tf'), '/tf')

    def told():
        node.object_frame.broadcast(estimate)
        return heard

    user.wait(told, 'the transform')
    assert heard[0].transforms == [estimate_to_transform(estimate, child)]
