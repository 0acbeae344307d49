"""`make soak`: hundreds of captures through a whole graph; what is lost, what grows, what stays.

A simulated camera is triggered through lytro_driver, over its own protocol and real DDS, and the
poses are counted. Exit status 1 when anything is not as it must be.
"""

import argparse
import json
import math
import os
import sys
from collections import Counter
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, time_ns
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress
from scipy.stats import linregress

from pmcl_ros.camera.simulated.server import served
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.messages.bag_captures import extract_captures
from pmcl_ros.nodes.bench.disturbances import ARGUMENTS, Disturbances
from pmcl_ros.nodes.bench.running_graph import (
    Graph,
    GraphError,
    Usage,
    files_shared_without,
    shared_files,
)
from pmcl_ros.nodes.graph import NODES
from pmcl_ros.nodes.runtime.running import ros
from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.ros_domain import own_domain

_ROOT = Path(__file__).parents[3]
_CONSOLE = Console(stderr=True)
# On their way at once: one is searched, one is decoded or waits. A third could overtake.
_UNDER_WAY = 2
_STALLED = 60.0  # s: then what has not come does not come
_STALLED_DISTURBED = 15.0  # s: what a killed process held never comes
_REPORT = 10.0  # s: for the last diagnostics, which come at 1 Hz
_PARTS = 10  # times that the graph runs empty and its processes are measured
# MB that a process may have grown: less than three raw pictures; one that was kept at each capture
# would be far more.
_FLAT = 60.0
_ENOUGH = 100  # captures: before, what is kept for the next time is still growing
# From _MANY captures on a line through the memory of the later half must be flatter: MB in 1,000
# captures, by two standard errors.
_MANY, _SLOPE = 1000, 1.0
_LINE = 3  # points: a line through fewer has no error
_DESCRIPTORS, _THREADS = 4, 2  # which may come and go
_QUICK: dict[str, dict[str, Any]] = {
    'dlv_node': {'labels': 16, 'edge_labels': 8, 'views': 3},
    'pmcl_node': {'mode': 'faithful', 'faithful_iterations': 1, 'faithful_particles': 4}}


@dataclass
class Soak:
    """The result of a soak test.

    captures: published, by their stamps. poses: that came. twice: stamps that came again. strange:
    of no capture. lost: captures in which the object was not found. dropped, errors: as the nodes
    report on /diagnostics, by node. unreported: captures without a pose and without a report.
    latency: from shutter to pose, seconds: percentiles. memory, descriptors, threads: by process,
    each time the graph had run empty. left: files in /dev/shm that outlived the graph.
    diagnostics: by node, the values of its last message on /diagnostics.
    disturbances: how often each happened. killed: processes of the graph, among them.
    unanswered: captures that a driver was asked for and did not answer, as it was killed.
    """

    captures: int = 0
    poses: int = 0
    twice: int = 0
    strange: int = 0
    lost: int = 0
    refused: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    errors: dict[str, int] = field(default_factory=dict)
    unreported: int = 0
    seconds: float = 0
    latency: dict[str, float] = field(default_factory=dict)
    after: list[int] = field(default_factory=list)
    memory: dict[str, list[float]] = field(default_factory=dict)
    descriptors: dict[str, list[int]] = field(default_factory=dict)
    threads: dict[str, list[int]] = field(default_factory=dict)
    left: list[str] = field(default_factory=list)
    diagnostics: dict[str, dict[str, str]] = field(default_factory=dict)
    status: int = 0
    tracebacks: int = 0
    disturbances: dict[str, int] = field(default_factory=dict)
    killed: int = 0
    unanswered: int = 0

    def violations(self, flood: bool) -> list[str]:
        """What is not as it must be, in words. flood: captures came faster than can be used."""
        # What a process held when it was killed is reported by the log of pmcl_bringup alone, and
        # Fast DDS leaves its files of shared memory.
        untold = (max(self.unreported - _UNDER_WAY * self.killed, 0)
                  or min(self.unreported + self.unanswered, 0))
        found = [(self.twice, 'poses of a capture that had one already'),
                 (max(self.strange - self.unanswered, 0), 'poses of no capture'),
                 (abs(untold), 'captures too few, or too many, are reported as lost'),
                 (sum(self.errors.values()), 'errors'), (self.refused, 'captures refused'),
                 (0 if flood or self.killed else sum(self.dropped.values()), 'captures dropped'),
                 (0 if self.killed else len(self.left),
                  f'files left in /dev/shm: {", ".join(self.left)}'),
                 (self.tracebacks, 'tracebacks'),
                 (abs(self.status), 'is the exit status of the graph, not 0')]
        words = [f'{count} {what}' for count, what in found if count]
        memory = self.memory if self.captures >= _ENOUGH else {}
        for values, most, what in ((memory, _FLAT, 'MB'),
                                   (self.descriptors, _DESCRIPTORS, 'descriptors'),
                                   (self.threads, _THREADS, 'threads')):
            for name, each in values.items():
                if each[-1] - each[0] > most:
                    words.append(f'{name} grew by {each[-1] - each[0]:.0f} {what}')
        if not self.killed:  # else what is kept of participants that came and went grows, too
            words += [f'{name} grows by {slope:.1f} +- {error:.1f} MB in 1,000 captures'
                      for name, (slope, error) in self.slopes.items()
                      if slope - 2 * error > _SLOPE]
        return words

    @property
    def slopes(self) -> dict[str, tuple[float, float]]:
        """Of a line through the memory of each process: MB in 1,000 captures, standard error.

        Of the later half of a long run: in the first, what is kept for the next time still grows.
        Of processes that were measured three times there.
        """
        found = {}
        for name, memory in self.memory.items() if self.captures >= _MANY else ():
            later = np.array(self.after[-len(memory):]) >= self.captures / 2
            captures, values = np.array(self.after[-len(memory):])[later], np.array(memory)[later]
            if len(values) >= _LINE:
                line = linregress(captures / 1000, values)
                found[name] = (float(line.slope), float(line.stderr))
        return found

    def markdown(self) -> list[str]:
        """A table."""
        missing = self.captures - self.poses
        rows = [('captures, poses, lost', f'{self.captures}, {self.poses}, {self.lost}'),
                ('without a pose, and reported as lost, dropped or failed',
                 f'{missing}, {missing - self.unreported}'),
                ('rate', f'{self.captures / self.seconds:.2f} captures/s'),
                ('shutter to pose', ', '.join(f'{name} {1e3 * each:.0f} ms'
                                              for name, each in self.latency.items()))]
        for values, unit in ((self.memory, 'MB'), (self.descriptors, 'descriptors'),
                             (self.threads, 'threads')):
            for name, each in values.items():
                after = ', '.join(map(str, self.after[-len(each):]))
                rows.append((f'{name}: {unit} after {after} captures',
                             ', '.join(f'{one:.0f}' for one in each)))
        rows += [(f'{name}: growth of the later half', f'{slope:+.1f} +- {error:.1f} MB in 1,000 '
                  'captures') for name, (slope, error) in self.slopes.items()]
        rows += [(f'disturbance: {what}', f'{count} times')
                 for what, count in self.disturbances.items()]
        rows.append(('left in /dev/shm', str(len(self.left))))
        return ['| what | result |', '|---|---|', *(f'| {name} | {each} |' for name, each in rows)]


def soak(captures: int, bag: Path, arguments: list[str], quick: bool, flood: bool,
         log: Path, disturbances: int = 0) -> Soak:
    """Take `captures` pictures of what is in a bag.

    log: where what the graph prints is written. quick: small volumes and a search that finds
    little: for the graph, not for the poses.
    flood: press the shutter whenever the driver can, whatever becomes of the captures.
    disturbances: so often, while captures are under way, a process is killed, time jumps, or
    another graph comes and goes.
    """
    result: Soak | None = None
    with ExitStack() as stack:
        before = set(Path('/dev/shm').iterdir())  # what other programs share, or have left
        stack.enter_context(ros())
        folder = Path(stack.enter_context(TemporaryDirectory()))
        (folder / 'pictures').mkdir()
        extract_captures(bag, folder / 'pictures')
        address, _ = stack.enter_context(served(folder / 'pictures', '--empty', '--delay', '0'))
        truth = Truth.load(bag / 'truth.json')
        parameters: dict[str, dict[str, Any]] = {
            'lytro_driver': {'address': address.text, 'delete': True},
            'subaperture_node': {
                'calibration': str(_ROOT / 'config' / 'cameras' / 'demo.yaml'),
                'white': str(_ROOT / 'config' / 'cameras' / 'demo_white.RAW.xz')},
            'dlv_node': {}, 'pmcl_node': {
                'object': str(_ROOT / 'models' / f'{bag.name}.obj'),
                'roi_center': list(truth.roi_center), 'roi_size': list(truth.roi_size)}}
        for name, values in (_QUICK if quick else {}).items():
            parameters[name] |= values
        graph = Graph(parameters, folder / 'graph', [*arguments, *(
            ARGUMENTS if disturbances else ())])
        second = {**parameters, 'lytro_driver': {
            'source': 'files', 'path': str(folder / 'pictures')}}
        with graph, Progress(console=_CONSOLE, transient=True) as bar:
            task = bar.add_task('captures', total=captures)
            run = _Run(graph, flood, lambda done: bar.update(task, completed=done),
                       Disturbances(graph, second),
                       set(_evenly(max(captures // 20, 1), captures, disturbances)))
            for last in _evenly(min(max(captures // 10, 4), captures), captures, _PARTS):
                run.take(last)
                run.measure()
            shared = set().union(*map(shared_files, graph.processes.values()))
            shared -= files_shared_without(graph.processes.values())
            result = run.result()
        result.status, result.tracebacks = graph.status, graph.log.count('Traceback')
        log.write_text(graph.log)
        for line in graph.log.splitlines():
            if 'ERROR' in line or 'FATAL' in line:
                _CONSOLE.print(line, markup=False)
    if result is None:
        raise GraphError('interrupted; there is no report')
    # Only now this process has let go of what it shared with the graph.
    result.left = sorted(str(each) for each in shared - before if each.exists())
    return result


def _evenly(first: int, last: int, count: int) -> list[int]:
    """Some `count` numbers of captures from the first to the last one, each once."""
    return sorted({int(each) for each in np.linspace(first, last, count)})


class _Run:
    def __init__(self, graph: Graph, flood: bool, show: Callable[[int], None],
                 disturbances: Disturbances, disturbed: AbstractSet[int]) -> None:
        self._graph, self._flood, self._show = graph, flood, show
        self._disturbances, self._disturbed = disturbances, disturbed  # when
        self._stalled = _STALLED_DISTURBED if disturbed else _STALLED
        self._pids: dict[str, int] = {}
        self._began = monotonic()
        self._answers: list[Any] = []  # futures of what the driver answers
        self._gone = 0  # captures that were given up waiting for
        self._soak = Soak()

    def take(self, last: int) -> None:
        """Press the shutter until `last` captures are taken; return when all has come of them."""
        while len(self._answers) < last:
            self._await(lambda: all(each.done() for each in self._answers[-1:]))
            if not self._flood:
                self._await(lambda: len(self._answers) - self._finished() < _UNDER_WAY)
            # What was given up may have come, or been reported, since.
            self._gone -= min(self._gone, max(self._finished() - len(self._answers), 0))
            self._answers.append(self._graph.capture())
            self._show(len(self._answers))
            if len(self._answers) in self._disturbed:
                self._disturbances.next()
        self._await(lambda: self._finished() >= last)

    def measure(self) -> None:
        """Note memory, descriptors and threads of the processes."""
        self._soak.after.append(len(self._answers))
        for name, pid in self._graph.processes.items():
            usage = Usage.from_pid(pid)
            if self._pids.setdefault(name, pid) != pid:  # it was killed since
                self._pids[name] = pid
                for series in (self._soak.memory, self._soak.descriptors, self._soak.threads):
                    series[name].clear()
            self._soak.memory.setdefault(name, []).append(usage.memory)
            self._soak.descriptors.setdefault(name, []).append(usage.descriptors)
            self._soak.threads.setdefault(name, []).append(usage.threads)

    def result(self) -> Soak:
        """All that can be said while the graph still runs."""
        made = self._soak
        made.seconds = monotonic() - self._began
        until = monotonic() + _REPORT
        self._graph.wait(lambda: monotonic() > until or self._balance(made) == 0, 'its last words')
        made.unreported = self._balance(made)
        made.diagnostics = self._graph.diagnostics
        made.disturbances, made.killed = self._disturbances.done, self._disturbances.killed
        times = [1e-9 * (arrived - stamp) for stamp, arrived, _ in self._graph.poses]
        if times:
            made.latency = {f'{each} %': float(np.percentile(times, each))
                            for each in (50, 90, 99, 100)}
        return made

    def _balance(self, made: Soak) -> int:
        stamps = {int(each.result().message.rpartition(' ')[2]) for each in self._answers
                  if each.done() and each.result().success}
        came = Counter(stamp for stamp, _, _ in self._graph.poses)
        made.captures, made.poses = len(stamps), len(came)
        made.unanswered = sum(not each.done() for each in self._answers)
        made.refused = len(self._answers) - len(stamps) - made.unanswered
        made.twice, made.strange = sum(came.values()) - len(came), len(came.keys() - stamps)
        made.dropped, made.errors = (
            {name: count for name in _NAMES if (count := self._graph.count(name, what))}
            for what in ('dropped', 'errors'))
        made.lost = self._graph.count('pmcl_node', 'lost')
        return (made.captures - made.poses - made.lost - sum(made.dropped.values())
                - sum(made.errors.values()))

    def _finished(self) -> int:
        refused = sum(each.done() and not each.result().success for each in self._answers)
        return (len(self._graph.poses) + self._graph.count('pmcl_node', 'lost') + refused
                + self._gone + sum(self._graph.count(name, what) for name in _NAMES
                                   for what in ('dropped', 'errors')))

    def _await(self, condition: Callable[[], bool]) -> None:
        """Until it is so, or nothing more comes."""
        seen, since = self._finished(), monotonic()

        def over() -> bool:
            nonlocal seen, since
            if self._finished() != seen:
                seen, since = self._finished(), monotonic()
            return condition() or monotonic() - since > self._stalled

        self._graph.wait(over, 'a capture', timeout=math.inf)
        if not condition():
            self._gone = max(len(self._answers) - seen + self._gone, self._gone)


_NAMES = tuple(entry.name for entry in NODES)


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog='pmcl_soak', description=__doc__)
    parser.add_argument('--captures', type=int, default=500)
    parser.add_argument('--processes', action='store_true', help='a process for each node')
    parser.add_argument('--flood', action='store_true', help='captures come faster than they can '
                        'be used: some are dropped, and all that are must be reported')
    parser.add_argument('--disturbances', type=int, default=0, metavar='N', help='with '
                        '--processes: N times a node is killed, time jumps, or a second graph '
                        'comes and goes')
    parser.add_argument('--quick', action='store_true', help='small volumes, hardly any search')
    parser.add_argument('--bag', type=Path, default=_ROOT / 'bags' / 'wine_glass',
                        help='what the camera sees, with its truth.json and models/NAME.obj')
    parser.add_argument('--out', type=Path, default=Path('out') / 'soak',
                        help='folder for soak.json, soak.md and graph.log')
    options = parser.parse_args()
    if options.disturbances < 0 or (options.disturbances and not options.processes):
        parser.error('--disturbances is a number of times and needs --processes: a node is killed '
                     'by its process')
    own_domain()
    began = time_ns()
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        result = soak(options.captures, options.bag, ['--processes'] if options.processes else [],
                      options.quick, options.flood, options.out / 'graph.log',
                      options.disturbances)
    except PmclError as error:
        _CONSOLE.print(f'pmcl_soak: {error}', markup=False)
        return 1
    violations = result.violations(options.flood)
    report = [*result.markdown(), '', *(violations or ['All as it must be.'])]
    (options.out / 'soak.md').write_text('\n'.join(report) + '\n')
    (options.out / 'soak.json').write_text(json.dumps(
        asdict(result) | {'violations': violations, 'arguments': sys.argv[1:],
                          'began_ns': began, 'processors': os.cpu_count()}, indent=1))
    Console().print('\n'.join(report), markup=False, soft_wrap=True)
    return int(bool(violations))


if __name__ == '__main__':
    sys.exit(main())
