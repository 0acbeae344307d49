"""Nodes in processes of their own, and their supervisor, which restarts those that ended."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from pmcl_ros.nodes.graph import NodeEntry
from pmcl_ros.nodes.runtime.base import SMALL
from pmcl_ros.nodes.runtime.health import Health
from pmcl_ros.nodes.runtime.running import PARENT, SIGNALS, pause
from pmcl_ros.runtime import start
from pmcl_ros.runtime.errors import PmclError

_SOON, _LATE = 0.5, 30.0  # s: before a node is started again; doubled each time, up to the second
_PATIENCE = 30.0  # s: for a process to end before it is killed
_STEADY = 60.0  # s: who has run for so long is started again soon


class Running(Protocol):
    """A node that was started."""

    def alive(self) -> bool:
        """Whether it still runs."""

    def end(self) -> str:
        """How it ended, in words."""

    def stop(self) -> None:
        """End it and wait for that."""


class NodeProcess:
    """A node in a process of its own, which only this one signals."""

    def __init__(self, entry: NodeEntry, ros_args: Sequence[str]) -> None:
        # The child inherits the mask: what interrupts it while it still imports waits until it can
        # be noted.
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        try:
            # sys.executable: the pip build of ROS sets its library path for this interpreter alone
            self._process = subprocess.Popen(
                [sys.executable, '-m', start.__name__, entry.name, *ros_args],
                start_new_session=True, env=os.environ | {PARENT: str(os.getpid())})
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)

    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def end(self) -> str:
        """How it ended."""
        status = self._process.returncode
        return f'was ended by signal {-status}' if status < 0 else f'ended with status {status}'

    def stop(self) -> None:
        """Interrupt it; kill it when it does not end."""
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


@dataclass
class _Watched:
    process: Running
    started: float
    delay: float = _SOON


class Supervisor:
    """Looks after nodes that have been started and are active.

    node: to log and to publish /diagnostics with. start: starts the node of a name. activate:
    takes it to active, or raises PmclError.
    It reports the loss of the captures that a node held when it ended.
    """

    def __init__(self, node: Node, running: dict[str, Running],
                 start: Callable[[str], Running], activate: Callable[[str], None]) -> None:
        self._node, self._start, self._activate = node, start, activate
        self._running = running  # the caller stops what is in it in the end
        self._watched = {name: _Watched(each, time.monotonic())
                         for name, each in running.items()}
        self._health = Health()
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', SMALL)

    def check(self) -> None:
        """Start again who has ended; returns when all are active, unless one cannot be."""
        for name, each in self._watched.items():
            if not each.process.alive():
                self._revive(name, each)
        self._publish_diagnostics()

    def _revive(self, name: str, each: _Watched) -> None:
        each.delay = _SOON if time.monotonic() - each.started > _STEADY else each.delay
        problem = (f'{name} {each.process.end()}: captures that were on their way through it are '
                   'lost')
        self._health.count(f'{name} started again')
        self._health.failed(problem)
        self._node.get_logger().error(f'{problem}; it is started again in {each.delay:g} s')
        self._publish_diagnostics()
        pause(each.delay)
        each.delay, each.started = min(2 * each.delay, _LATE), time.monotonic()
        each.process = self._running[name] = self._start(name)
        try:
            self._activate(name)
        except PmclError as error:
            self._node.get_logger().error(
                f'{name} was started again and cannot be activated: {error}')
            each.process.stop()  # the next look starts it again, later
            return
        self._health.recovered()
        self._node.get_logger().info(f'{name} is active again')

    def _publish_diagnostics(self) -> None:
        name = self._node.get_fully_qualified_name().lstrip('/')
        now = self._node.get_clock().now().nanoseconds
        self._publisher.publish(self._health.to_message(now, name))
