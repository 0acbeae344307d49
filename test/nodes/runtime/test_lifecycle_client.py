"""The client that takes nodes through their transitions, where messages come late."""

import threading

import pytest
import rclpy
from harness import PATIENCE
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node

from pmcl_ros.nodes.runtime.lifecycle import CONFIGURE, Lifecycle, LifecycleError


@pytest.fixture
def slow():
    """A node's services; the first request for a transition waits until the second has come."""
    context = Context()
    rclpy.init(context=context)
    node = Node('slow', context=context)
    second, made = threading.Event(), threading.Event()
    state, requests = [State.PRIMARY_STATE_UNCONFIGURED], []
    ends_in = [State.PRIMARY_STATE_INACTIVE]

    def change(request, response):
        requests.append(request.transition.id)
        if len(requests) == 1:
            second.wait()
            state[:] = ends_in
            made.set()
            response.success = True
        else:
            second.set()
            made.wait()
        return response  # it has left the state from which the transition goes

    def tell(_, response):
        response.current_state.id = state[0]
        return response

    group = ReentrantCallbackGroup()
    node.create_service(ChangeState, '~/change_state', change, callback_group=group)
    node.create_service(GetState, '~/get_state', tell, callback_group=group)
    executor = MultiThreadedExecutor(3, context=context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    yield requests, ends_in
    for each in (second, made):
        each.set()
    executor.shutdown()
    thread.join()
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture
def lifecycle(user):
    context = user.node.context
    node, executor = Node('client', context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield Lifecycle(node, executor, lambda _: None)
    executor.shutdown()
    node.destroy_node()


def test_a_second_request_that_is_refused_since_the_first_came_late_is_no_failure(slow, lifecycle):
    requests, _ = slow
    lifecycle.change('slow', CONFIGURE, PATIENCE)
    assert len(requests) >= 2  # it may ask again before an answer comes, on a busy machine


def test_a_transition_that_was_not_made_fails(slow, lifecycle):
    requests, ends_in = slow
    ends_in[:] = [State.PRIMARY_STATE_UNCONFIGURED]
    with pytest.raises(LifecycleError, match='slow could not configure; its log says why'):
        lifecycle.change('slow', CONFIGURE, PATIENCE)
    assert len(requests) >= 2
