"""A supervisor of real processes: who ends is started again, later each time, until it works."""

import re
import subprocess
import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.node import Node

from pmcl_ros.nodes.runtime.base import SMALL
from pmcl_ros.nodes.runtime.supervision import Supervisor
from pmcl_ros.runtime.errors import PmclError


class Child:
    """A process that does nothing, until it is ended."""

    def __init__(self):
        self._process = subprocess.Popen(['cat'], stdin=subprocess.PIPE)
        self.began = time.monotonic()

    def alive(self):
        return self._process.poll() is None

    def end(self):
        return f'ended with status {self._process.returncode}'

    def stop(self):
        self._process.stdin.close()
        self._process.wait()


@pytest.fixture
def node():
    context = Context()
    rclpy.init(context=context)
    node = Node('bringup', context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_who_cannot_be_activated_is_tried_again_and_more_slowly(node, user, capfd):
    started, refusals = [Child(), Child()], 2

    def start(name):
        assert name == 'weak'
        started.append(Child())
        return started[-1]

    def activate(name):
        if len(started) < 3 + refusals:
            raise PmclError(f'{name} does not answer')

    running = {'weak': started[0], 'steady': started[1]}
    supervisor = Supervisor(node, running, start, activate)
    states = []
    user.node.create_subscription(DiagnosticArray, '/diagnostics', states.append, SMALL)
    try:
        supervisor.check()
        assert len(started) == 2  # both run
        started[0].stop()
        ended = []
        for count in range(1, 2 + refusals):
            ended.append(time.monotonic())
            supervisor.check()
            assert len(started) == 2 + count
            assert running == {'weak': started[-1], 'steady': started[1]}
            assert started[-1].alive() == (count > refusals)  # else its activation is not trusted

        def last():
            return {each.key: each.value for each in states[-1].status[0].values} if states else {}

        def recovered():  # it was OK before, too
            supervisor.check()
            return (last().get('weak started again') == '3'
                    and states[-1].status[0].level == DiagnosticStatus.OK)

        user.wait(recovered, 'its recovery to be told')
        assert len(started) == 3 + refusals
    finally:
        for each in started:
            each.stop()
    waited = [child.began - end for child, end in zip(started[2:], ended, strict=True)]
    status, = states[-1].status
    assert (status.name, last()['errors']) == ('bringup', '3')
    assert 'captures that were on their way through it are lost' in last()['last error']
    log = capfd.readouterr().err
    told = [float(each) for each in re.findall(r'it is started again in (\S+) s', log)]
    assert told == [told[0], 2 * told[0], 4 * told[0]]
    assert all(one >= other for one, other in zip(waited, told, strict=True))
    assert log.count('weak was started again and cannot be activated: weak does not answer') == 2
    assert log.count('weak is active again') == 1
