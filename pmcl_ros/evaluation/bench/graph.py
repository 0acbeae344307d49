"""From shutter to pose through a graph in one process, beside the same without ROS."""

import json
import subprocess
import sys
from dataclasses import dataclass

from pmcl_ros.evaluation.bench.transport import BenchError


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


def bench_graph(captures: int = 20) -> GraphBench:
    """Take `captures` pictures of bags/wine_glass; BenchError without ROS."""
    # As a program: only nodes know ROS.
    process = subprocess.run(
        [sys.executable, '-m', 'pmcl_ros.evaluation.bench.latency', '--captures', str(captures)],
        stdout=subprocess.PIPE, text=True, check=False)
    if process.returncode:
        raise BenchError('no poses came, as the lines above say; it needs ROS 2, and the source '
                         'tree with its bags')
    return GraphBench(**json.loads(process.stdout))
