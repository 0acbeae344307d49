"""A whole graph in processes of its own: triggered, observed, ended."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from pmcl_ros.messages.pose import pose_from
from pmcl_ros.nodes.graph import NODES
from pmcl_ros.nodes.runtime.base import SMALL
from pmcl_ros.nodes.runtime.running import pause
from pmcl_ros.runtime import start
from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.usage import cpu_seconds

_PATIENCE = 240.0  # s: a machine may have to compile all kernels first
SHOWN = 2000  # characters of a log
COUNTERS = frozenset({'lost', 'dropped', 'errors'})  # on /diagnostics, of captures
_MANY = QoSProfile(depth=1000, reliability=SMALL.reliability)


class GraphError(PmclError):
    """The graph did not come up, or has ended."""

    def __str__(self) -> str:
        return str(self.args[0])  # with the lines of its log


class Graph:
    """`pmcl_bringup` with `parameters` of its nodes, and all that it says while it lasts.

    arguments: more for pmcl_bringup. namespace: of its nodes, as '/second'. beside: another graph,
    which is listened to while this one is waited for.
    poses: (stamp [ns], time of arrival [ns since the epoch], (4, 4) pose) as they came.
    diagnostics: by node name, the values of its last message on /diagnostics.
    folder: where its log and parameters are written. node: which listens for all that.
    Times of arrival are of this process, which must be spun: `wait`.
    """

    def __init__(self, parameters: Mapping[str, Mapping[str, Any]], folder: Path,
                 arguments: Sequence[str] = (), namespace: str = '',
                 beside: 'Graph | None' = None) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        file, self._log = folder / 'parameters.yaml', folder / 'log.txt'
        file.write_text(yaml.safe_dump({f'/**/{name}': {'ros__parameters': dict(values)}
                                        for name, values in parameters.items()}))
        self.poses: list[tuple[int, int, NDArray[np.float64]]] = []
        self.diagnostics: dict[str, dict[str, str]] = {}
        self.folder, self._beside = folder, beside
        self.node = Node('pmcl_observer', namespace=namespace or None)
        self._prefix = namespace.lstrip('/') + '/' if namespace else ''
        self._ended = Counter[tuple[str, str]]()  # counts of processes that have ended since
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.node.create_subscription(PoseStamped, 'pose', self._on_pose, _MANY)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_state, _MANY)
        self._shutter = self.node.create_client(Trigger, 'lytro_driver/capture')
        with self._log.open('w') as log:
            self._process = subprocess.Popen(
                [sys.executable, '-m', 'pmcl_ros.nodes.bringup', '--params-file', str(file),
                 *arguments, *(['--ros-args', '-r', f'__ns:={namespace}'] if namespace else [])],
                stdout=log, stderr=subprocess.STDOUT)

    def __enter__(self) -> 'Graph':
        try:
            self.wait(lambda: 'pmcl_bringup]: active: ' in self.log, 'the nodes to be active')
            self.wait(lambda: (self._shutter.service_is_ready()
                               and all(each.name in self.diagnostics for each in NODES)),
                      'the diagnostics of all nodes')
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.status = self._end()
        self._executor.shutdown()
        self.node.destroy_node()

    @property
    def log(self) -> str:
        """All that its processes have printed."""
        return self._log.read_text(errors='replace')

    @property
    def processes(self) -> dict[str, int]:
        """Its processes: name to process id."""
        pid = self._process.pid
        children = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
        return {'pmcl_bringup': pid} | {_node_of(int(each)): int(each) for each in children}

    @property
    def cpu_seconds(self) -> float:
        """The processor's time that its processes have used."""
        return sum(map(cpu_seconds, self.processes.values()))

    def count(self, node: str, key: str) -> int:
        """A counter of `node` on /diagnostics, with those of its processes that were killed."""
        return self._ended[node, key] + int(self.diagnostics.get(node, {}).get(key, 0))

    def capture(self) -> Any:
        """Press the shutter; the future of what the driver answers."""
        return self._shutter.call_async(Trigger.Request())

    def kill(self, name: str) -> None:
        """Kill the process of a node, and return when another one is active in its place."""
        done = f'{name} is active again'
        before = self.log.count(done)
        os.kill(self.processes[name], signal.SIGKILL)
        for key, value in self.diagnostics.pop(name, {}).items():
            if key in COUNTERS:
                self._ended[name, key] += int(value)
        self.wait(lambda: self.log.count(done) > before, f'{name} to be active again')

    def listen(self) -> None:
        """Take one message, if one has come."""
        self._executor.spin_once(timeout_sec=0)

    def wait(self, condition: Callable[[], object], what: str,
             timeout: float = _PATIENCE) -> None:
        """Listen until something is so; GraphError after `timeout` [s] or when the graph ends.

        Interrupted when a signal comes.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            ended = self._process.poll()
            if ended is not None or time.monotonic() > deadline:
                what = (f'waited {timeout:g} s for {what}' if ended is None
                        else f'pmcl_bringup ended with {ended}')
                raise GraphError(f'{what}; its last lines are\n{self.log[-SHOWN:]}')
            pause(0)
            self._executor.spin_once(timeout_sec=0.05)
            if self._beside is not None:
                self._beside.listen()

    def _on_pose(self, message: PoseStamped) -> None:
        now = time.time_ns()
        header, pose = pose_from(message)
        self.poses.append((header.stamp_ns, now, pose))

    def _on_state(self, message: DiagnosticArray) -> None:
        for each in message.status:
            name = each.name.removeprefix(self._prefix)
            if each.name.startswith(self._prefix) and '/' not in name:  # else of another graph
                self.diagnostics[name] = {pair.key: pair.value for pair in each.values}

    def _end(self) -> int:
        self._process.send_signal(signal.SIGINT)
        try:
            return self._process.wait(60)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


def _node_of(pid: int) -> str:
    words = Path(f'/proc/{pid}/cmdline').read_bytes().split(b'\0')
    before = start.__name__.encode()  # which `NodeProcess` runs
    return words[words.index(before) + 1].decode() if before in words else str(pid)
