"""The benches that need ROS: each is a program of its own, which prints its result as JSON."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmcl_ros.evaluation.bench.checkout import ROOT
from pmcl_ros.nodes.runtime.shared_memory import VARIABLE
from pmcl_ros.runtime.errors import PmclError

_PROFILE = Path('config') / 'fastdds_shm.xml'


class BenchError(PmclError):
    """The bench could not be run."""


@dataclass(frozen=True)
class Transport:
    """sent, received, equal: messages, those that came, and those that came as they were.

    ms: medians, by `topic` from a volume to a numpy view of what came, and of the `copies` of its
    data that this takes, in the same two processes. ratio: of the two.
    """

    megabytes: float
    sent: int
    received: int
    equal: int
    ms: dict[str, float]
    ratio: float


@dataclass(frozen=True)
class TransportBench:
    """As Fast DDS is by default, and with the shipped profile for shared memory."""

    default: Transport
    shared_memory: Transport

    def lines(self) -> list[str]:
        """What to print."""
        return [f'{name}: {each.received} of {each.sent} volumes of {each.megabytes:.1f} MB came, '
                f'{each.equal} as they were; {each.ms["topic"]:.0f} ms, {each.ratio:.1f} times '
                f'the {each.ms["copies"]:.0f} ms of the copies'
                for name, each in (('default', self.default),
                                   ('config/fastdds_shm.xml', self.shared_memory))]


def bench_transport(messages: int = 200) -> TransportBench:
    """Send `messages` volumes of 328x328x75 each way; BenchError without ROS."""
    bare = {name: value for name, value in os.environ.items() if name != VARIABLE}
    bare.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    profile = ROOT / _PROFILE
    if not profile.is_file():
        raise BenchError(f'there is no {profile}: run the bench from the source tree')
    by_default, by_profile = (
        Transport(**_run('nodes.bench.volume_transport', ['--messages', str(messages)],
                         environment, 'the volumes were not sent, as the lines above say; it '
                         'needs ROS 2'))
        for environment in (bare, bare | {VARIABLE: str(profile)}))
    return TransportBench(by_default, by_profile)


@dataclass(frozen=True)
class GraphBench:
    """captures: taken by both in turn, of the same picture; equal: with the same pose.

    ms: medians, through the `graph`, from the shutter to the pose's arrival in another process,
    and `offline`, from the file to the pose. cpu_ms: the processor's time for both, all threads.
    ratio, worst_ratio: graph to offline, median and worst pair; cpu_ratio: of all the processor's
    time, which other programs that run meanwhile disturb less.
    """

    captures: int
    equal: int
    ms: dict[str, float]
    cpu_ms: dict[str, float]
    ratio: float
    worst_ratio: float
    cpu_ratio: float

    def lines(self) -> list[str]:
        """What to print."""
        return [f'{self.captures} captures, {self.equal} with the pose that comes without ROS',
                *(f'{name:>8}: {self.ms[name]:6.0f} ms, {self.cpu_ms[name]:6.0f} ms of the '
                  'processor' for name in self.ms),
                f'shutter to pose takes {self.ratio:.2f} times as long as without ROS (worst '
                f'{self.worst_ratio:.2f}), and {self.cpu_ratio:.2f} times the processor']


def bench_graph(captures: int = 20, edges: bool = False) -> GraphBench:
    """Take `captures` pictures of bags/wine_glass; BenchError without ROS.

    edges: search by edges alone: then the nodes compute no more than is computed without ROS.
    """
    return GraphBench(**_run('evaluation.bench.latency',
                             ['--captures', str(captures), *(['--edges'] if edges else [])],
                             os.environ,
                             'no poses came, as the lines above say; it needs ROS 2, and the '
                             'source tree with its bags'))


def _run(program: str, arguments: list[str], environment: Mapping[str, str],
         problem: str) -> dict[str, Any]:
    """The JSON that a module of pmcl_ros prints; BenchError with `problem` when it fails.

    It is a program of its own because Fast DDS reads its profile when a process starts.
    """
    process = subprocess.run(
        [sys.executable, '-m', f'pmcl_ros.{program}', *arguments],
        stdout=subprocess.PIPE, text=True, env=environment, check=False)
    if process.returncode:
        raise BenchError(problem)
    result: dict[str, Any] = json.loads(process.stdout)
    return result
