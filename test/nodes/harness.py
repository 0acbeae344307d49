"""Real node processes, and a node that plays their user. Everything waits for what it needs."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import rclpy
import yaml
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

ROOT = Path(__file__).parents[2]
CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, CLEANUP = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP
UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE = State.PRIMARY_STATE_ACTIVE
PATIENCE = 90.0  # s: two busy cores may compile meanwhile
REPEAT = 10.0  # s: then a service is asked again


class Process:
    """A process of the package, its output in a file; ends cleanly or fails the test."""

    def __init__(self, folder, module, *args, params=None, checked=True):
        self.name = module.rpartition('.')[2]
        self._log = folder / f'{self.name}.log'
        if params is not None:
            path = folder / f'{self.name}.yaml'
            path.write_text(yaml.safe_dump({'/**': {'ros__parameters': params}}))
            args = (*args, '--ros-args', '--params-file', path)
        with self._log.open('w') as log:
            self.popen = subprocess.Popen(
                [sys.executable, '-m', module, *map(str, args)], cwd=ROOT, stdout=log,
                stderr=subprocess.STDOUT,
                env=os.environ | {'ROS_PYTHON_CHECK_FIELDS': str(int(checked))})

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
            assert status == 0, f'{self.name} ended with {status}\n{self.log}'

    @property
    def log(self):
        return self._log.read_text()

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

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait(self, condition, what, timeout=PATIENCE):
        """Spin until `condition` is true; its value."""
        deadline = time.monotonic() + timeout
        while not (value := condition()):
            assert time.monotonic() < deadline, f'waited {timeout} s for {what}'
            self._executor.spin_once(timeout_sec=0.02)
        return value

    def call(self, kind, name, request, again=lambda: True):
        """A service's answer; asked again while `again()`, as DDS may lose one right after the
        two have found each other. None: not to be asked again."""
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready, name)
        deadline = time.monotonic() + PATIENCE
        while True:
            asked, future = time.monotonic(), client.call_async(request)
            self.wait(lambda future=future, until=asked + REPEAT:
                      future.done() or time.monotonic() > until, name)
            if future.done() or not again() or future.done():
                break
            assert time.monotonic() < deadline, f'waited {PATIENCE} s for an answer of {name}'
        self.node.destroy_client(client)
        return future.result() if future.done() else None

    def change(self, node, *transitions):
        """Ask for transitions; whether each was made."""
        made = [self._change(node, each) for each in transitions]
        return made[0] if len(made) == 1 else made

    def _change(self, node, transition):
        before = self.state(node)
        answer = self.call(ChangeState, f'/{node}/change_state',
                           ChangeState.Request(transition=Transition(id=transition)),
                           again=lambda: self.state(node) == before)
        return answer is None or answer.success

    def state(self, node):
        return self.call(GetState, f'/{node}/get_state', GetState.Request()).current_state.id

    def set(self, node, **values):
        """Set parameters; the reasons of those that were refused."""
        parameters = [Parameter(name, value=value).to_parameter_msg()
                      for name, value in values.items()]
        request = SetParameters.Request(parameters=parameters)
        results = self.call(SetParameters, f'/{node}/set_parameters', request).results
        return [each.reason for each in results if not each.successful]

    def listen(self, kind, topic, qos):
        """A list that grows with the messages of a topic, once it has a publisher."""
        messages = []
        subscription = self.node.create_subscription(kind, topic, messages.append, qos)
        self.wait(subscription.get_publisher_count, f'a publisher of {topic}')
        return messages

    def publisher(self, kind, topic, qos=None):
        """A publisher that has a subscriber."""
        publisher = self.node.create_publisher(kind, topic, qos or QoSProfile(depth=1))
        self.wait(publisher.get_subscription_count, f'a subscriber of {topic}')
        return publisher

    def publishers_of(self, node):
        """The topics that a node publishes, once it is there."""
        self.wait(lambda: node in self.node.get_node_names(), node)
        return sorted(name for name, _ in
                      self.node.get_publisher_names_and_types_by_node(node, '/'))
