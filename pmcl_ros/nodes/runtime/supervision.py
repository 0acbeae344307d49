"""Starts again what has ended, and takes it to active: for graphs that nobody looks after."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from pmcl_ros.nodes.runtime.base import SMALL
from pmcl_ros.nodes.runtime.health import Health
from pmcl_ros.nodes.runtime.running import pause
from pmcl_ros.runtime.errors import PmclError

_SOON, _LATE = 0.5, 30.0  # s: before a node is started again; doubled each time, up to the second
_STEADY = 60.0  # s: who has run for so long is started again soon


class Supervised(Protocol):
    """A node's process."""

    def alive(self) -> bool:
        """Whether it still runs."""

    def end(self) -> str:
        """How it ended."""

    def stop(self) -> None:
        """End it and wait for that."""


@dataclass
class _Watched:
    process: Supervised
    started: float
    delay: float = _SOON


class Supervisor:
    """Looks after nodes that have been started and are active.

    node: to log and to publish /diagnostics with. start: starts the node of a name. activate:
    takes it to active, or raises PmclError.
    What a node held when it ended is lost, and only this one knows that it was: it says so.
    """

    def __init__(self, node: Node, running: dict[str, Supervised],
                 start: Callable[[str], Supervised], activate: Callable[[str], None]) -> None:
        self._node, self._start, self._activate = node, start, activate
        self._running = running  # the caller stops what is in it in the end
        self._watched = {name: _Watched(each, time.monotonic())
                         for name, each in running.items()}
        self._health = Health()
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', SMALL)

    def look(self) -> None:
        """Start again who has ended; returns when all are active, unless one cannot be."""
        for name, each in self._watched.items():
            if not each.process.alive():
                self._revive(name, each)
        self._tell()

    def _revive(self, name: str, each: _Watched) -> None:
        each.delay = _SOON if time.monotonic() - each.started > _STEADY else each.delay
        problem = (f'{name} {each.process.end()}: captures that were on their way through it are '
                   'lost')
        self._health.count(f'{name} started again')
        self._health.failed(problem)
        self._node.get_logger().error(f'{problem}; it is started again in {each.delay:g} s')
        self._tell()
        pause(each.delay)
        each.delay, each.started = min(2 * each.delay, _LATE), time.monotonic()
        each.process = self._running[name] = self._start(name)
        try:
            self._activate(name)
        except PmclError as error:
            self._node.get_logger().error(f'{name} was started again and is of no use: {error}')
            each.process.stop()  # the next look starts it again, later
            return
        self._health.recovered()
        self._node.get_logger().info(f'{name} is active again')

    def _tell(self) -> None:
        name = self._node.get_fully_qualified_name().lstrip('/')
        now = self._node.get_clock().now().nanoseconds
        self._publisher.publish(self._health.to_message(now, name))
