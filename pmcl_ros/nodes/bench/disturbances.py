"""What happens to a graph in the field: nodes die, time jumps, disks are full, a second graph."""

import errno
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from pmcl_ros.messages.header import time_to_message
from pmcl_ros.nodes.bench.running_graph import SHOWN, Graph, GraphError
from pmcl_ros.nodes.graph import NODES

ARGUMENTS = ('--processes', '--respawn', '--ros-args', '-p', 'use_sim_time:=true', '--')
_TIMES = (1_000, 5, 1_000_000, 0)  # s, of /clock: there, back, far ahead, back
_KILL = 'a node is killed'
_JUMP, _SECOND = 'time jumps', 'a second graph'
_CYCLE = (_KILL, _JUMP, _KILL, _SECOND)
_ZEROS = bytes(4096)  # a page of a tmpfs


class Disturbances:
    """Disturbs a graph that was started with ARGUMENTS, in a fixed order.

    second: parameters of the graph that comes and goes beside it. disks: small ones, each of which
    is filled, until the next disturbance; by what is then told. killed: how many processes were
    killed so far. done: how often each disturbance happened.
    """

    def __init__(self, graph: Graph, second: Mapping[str, Mapping[str, Any]],
                 disks: Mapping[str, Path]) -> None:
        self._graph, self._second, self._disks = graph, second, disks
        self._cycle = (*disks, *_CYCLE)
        self._full: Path | None = None  # a file that fills a disk
        self._clock = graph.node.create_publisher(Clock, '/clock', QoSProfile(depth=10))
        self._names = [entry.name for entry in NODES]
        self.killed = 0
        self.done: dict[str, int] = {}

    def next(self) -> None:
        """The next one; GraphError where a graph does not recover from it."""
        count = sum(self.done.values())
        what = self._cycle[count % len(self._cycle)]
        if self._full is not None:
            self._full.unlink()
            self._full = None
        if what == _KILL:
            self._graph.kill(self._names[self.killed % len(self._names)])
            self.killed += 1
        elif what in self._disks:
            self._full = fill(self._disks[what])
        elif what == _JUMP:
            now = _TIMES[self.done.get(what, 0) % len(_TIMES)]
            self._clock.publish(Clock(clock=time_to_message(now * 10**9)))
        else:
            self._run_second(self.done.get(what, 0))
        self.done[what] = self.done.get(what, 0) + 1

    def _run_second(self, number: int) -> None:
        graph = Graph(self._second, self._graph.folder / f'second{number}',
                      namespace='/second', beside=self._graph)
        with graph:
            graph.capture()
            graph.wait(lambda: graph.poses or graph.count('pmcl_node', 'lost'),
                       'an answer of the second graph')
        if graph.status or 'Traceback' in graph.log:
            raise GraphError(f'the second graph ended with {graph.status}; its last lines are\n'
                             f'{graph.log[-SHOWN:]}')


def fill(disk: Path) -> Path:
    """Write a file that takes all the room that is left on a disk. Raises OSError if it cannot."""
    path = disk / 'full'
    with path.open('wb', buffering=0) as file:
        try:
            while True:
                file.write(_ZEROS)
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise
    return path
