"""Real node processes, and a node that plays their user. Everything waits for what it needs."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import fork_server
import rclpy
import yaml
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

ROOT = Path(__file__).parents[2]
CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, CLEANUP = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP
UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE = State.PRIMARY_STATE_ACTIVE
PATIENCE = 300.0  # s: two busy cores may compile meanwhile; only a failure takes that long
REPEAT = 5.0  # s: then a node is asked for its state again


def own_lines(text):
    """The text without the lines of Fast DDS about its ports in shared memory.

    Participants of all domains share them: one that is killed at the wrong moment leaves a port
    that the others cannot open. They go on without it, and say so on standard output.
    """
    return ''.join(line for line in text.splitlines(keepends=True)
                   if 'RTPS_TRANSPORT_SHM' not in line)


class Process:
    """A process of the package, its output in a file; ends with `status` or fails the test.

    root: where it is started, and where its package is.
    """

    def __init__(self, folder, module, *args, params=None, checked=True, status=0, root=ROOT):
        self.name = module.rpartition('.')[2]
        self._status = status
        self._log = folder / f'{self.name}.log'
        if params is not None:
            path = folder / f'{self.name}.yaml'
            path.write_text(yaml.safe_dump({'/**': {'ros__parameters': params}}))
            args = (*args, '--ros-args', '--params-file', path)
        environment = os.environ | {'ROS_PYTHON_CHECK_FIELDS': str(int(checked)),
                                    'NUMBA_NUM_THREADS': '1'}  # as in conftest.py
        with self._log.open('w') as log:
            # Messages read whether they check their fields when they are imported.
            if module in fork_server.PROGRAMS and checked and root == ROOT:
                self.popen = fork_server.Forked(module, [*map(str, args)], self._log, environment)
                return
            self.popen = subprocess.Popen(
                [sys.executable, '-m', module, *map(str, args)], cwd=root, stdout=log,
                stderr=subprocess.STDOUT, env=environment)

    def __enter__(self):
        return self

    def __exit__(self, failed, *_):
        if self.popen.poll() is None:
            self.popen.send_signal(signal.SIGINT)
        try:
            status = self.popen.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            raise
        if failed:
            sys.stdout.write(self.log)  # pytest shows it with the failure
        else:
            assert status == self._status, f'{self.name} ended with {status}\n{self.log}'

    @property
    def log(self):
        return own_lines(self._log.read_text())

    def alive(self):
        return self.popen.poll() is None


class User:
    """A node in this process that talks to the nodes under test."""

    def __init__(self):
        self._context = Context()
        rclpy.init(context=self._context)
        self.node = Node('user', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.others = []  # executors that are spun as well, of nodes in this process

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait(self, condition, what, timeout=PATIENCE):
        """Spin until `condition` is true; its value."""
        deadline = time.monotonic() + timeout
        while not (value := condition()):
            assert time.monotonic() < deadline, f'waited {timeout} s for {what}'
            self.spin()
        return value

    def spin(self):
        """Handle what has come."""
        for each in (self._executor, *self.others):
            each.spin_once(timeout_sec=0.05)

    def meet(self, *nodes):
        """Return once each of `nodes` knows every publisher, subscription and client made so far.

        What is counted or ready here is what this side knows. To somebody that its sender does not
        know yet a message or an answer is not sent, and never will be; DDS tells participants of
        each other's endpoints in the order of their making, and `state` makes one.
        """
        for each in nodes:
            self.state(each)

    def call(self, kind, name, request):
        """A service's answer."""
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready, name)
        self.meet(name.strip('/').rpartition('/')[0])
        future = client.call_async(request)
        self.wait(future.done, f'an answer of {name}')
        self.node.destroy_client(client)
        return future.result()

    def state(self, node):
        """The node's state, asked for until it answers: see `meet`."""
        client = self.node.create_client(GetState, f'/{node}/get_state')
        self.wait(client.service_is_ready, client.srv_name)
        deadline, asked = time.monotonic() + PATIENCE, []
        while not (answered := [each for each in asked if each.done()]):
            assert time.monotonic() < deadline, f'waited {PATIENCE} s for an answer of {node}'
            asked.append(client.call_async(GetState.Request()))
            until = time.monotonic() + REPEAT
            self.wait(lambda until=until: any(each.done() for each in asked)
                      or time.monotonic() > until, f'the state of {node}')
        self.node.destroy_client(client)
        return answered[0].result().current_state.id

    def change(self, node, *transitions):
        """Ask for transitions; whether each was made."""
        made = [self.call(ChangeState, f'/{node}/change_state', ChangeState.Request(
            transition=Transition(id=each))).success for each in transitions]
        return made[0] if len(made) == 1 else made

    def set(self, node, **values):
        """Set parameters; the reasons of those that were refused."""
        parameters = [Parameter(name, value=value).to_parameter_msg()
                      for name, value in values.items()]
        request = SetParameters.Request(parameters=parameters)
        results = self.call(SetParameters, f'/{node}/set_parameters', request).results
        return [each.reason for each in results if not each.successful]

    def listen(self, kind, topic, qos):
        """A list that grows with the messages of a topic, once its publishers know."""
        messages = []
        subscription = self.node.create_subscription(kind, topic, messages.append, qos)
        self.wait(subscription.get_publisher_count, f'a publisher of {topic}')
        self.meet(*self._nodes(topic, self.node.get_publishers_info_by_topic))
        return messages

    def publisher(self, kind, topic, qos=None):
        """A publisher, once its subscribers know."""
        publisher = self.node.create_publisher(kind, topic, qos or QoSProfile(depth=1))
        self.wait(publisher.get_subscription_count, f'a subscriber of {topic}')
        self.meet(*self._nodes(topic, self.node.get_subscriptions_info_by_topic))
        return publisher

    def delivered(self, publisher):
        """Return once all that was published is in the histories of the subscribers."""
        self.wait(lambda: publisher.wait_for_all_acked(Duration(nanoseconds=1)),
                  f'{publisher.topic_name} to be delivered')

    def _nodes(self, topic, ask):
        """The nodes at the other end of a topic, once all their names have come."""
        name = self.node.resolve_topic_name(topic)

        def named():
            ends = [f'{each.node_namespace}/{each.node_name}'.strip('/') for each in ask(name)]
            return ends and not any('UNKNOWN' in each for each in ends) and ends

        return set(self.wait(named, f'the nodes of {topic}')) - {'user'}

    def publishers_of(self, node):
        """The topics that a node publishes, once it is there."""
        self.wait(lambda: node in self.node.get_node_names(), node)
        return sorted(name for name, _ in
                      self.node.get_publisher_names_and_types_by_node(node, '/'))
