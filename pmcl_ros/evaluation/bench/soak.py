"""`make soak`: hundreds of captures through a whole graph; what is lost, what grows, what stays.

A simulated camera is triggered through lytro_driver, over its own protocol and real DDS, and the
poses are counted. Exit status 1 when anything is not as it must be.
"""

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from collections.abc import Set as AbstractSet
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, time_ns
from types import MappingProxyType
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from pmcl_ros.camera.simulated.server import served
from pmcl_ros.evaluation.bench.checkout import BAG, CALIBRATION, QUICK, WHITE, object_in
from pmcl_ros.evaluation.bench.soak_report import UNDER_WAY, Soak
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.messages.bag_captures import extract_captures
from pmcl_ros.nodes.bench.disturbances import ARGUMENTS, Disturbances
from pmcl_ros.nodes.bench.running_graph import Graph, GraphError
from pmcl_ros.nodes.graph import NODES
from pmcl_ros.nodes.runtime.running import ros
from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.outputs import Results, write_file
from pmcl_ros.runtime.ros_domain import own_domain
from pmcl_ros.runtime.usage import Usage, files_shared_without, shared_files

_CONSOLE = Console(stderr=True)
_SHARED = Path('/dev/shm')
_LOGS = _SHARED / 'logs'  # a disk of its own
_SMALL = 64 * 2 ** 20  # bytes: as much shared memory as a container has by default
_MOUNTED = (f'mount -t tmpfs -o size={_SMALL} none {_SHARED} && mkdir {_LOGS} '
            f'&& mount -t tmpfs -o size=8m none {_LOGS} && ROS_LOG_DIR={_LOGS} exec "$@"')
_STALLED = 60.0  # s: then what has not come does not come
_STALLED_DISTURBED = 15.0  # s: what a killed process held never comes
_REPORT = 10.0  # s: for the last diagnostics, which come at 1 Hz
_PARTS = 40  # times that the graph runs empty and its processes are measured
_QUICK: dict[str, dict[str, Any]] = {
    'dlv_node': {'labels': 16, 'edge_labels': 8, 'views': 3},
    'pmcl_node': QUICK}


def soak(captures: int, bag: Path, arguments: list[str], quick: bool, flood: bool,
         log: Path, disturbances: int = 0, disks: Mapping[str, Path] = MappingProxyType({})
         ) -> Soak:
    """Take `captures` pictures of what is in a bag.

    log: where what the graph prints is written. quick: small volumes and a search that finds
    little: for the graph, not for the poses.
    flood: press the shutter whenever the driver can, whatever becomes of the captures.
    disturbances: so often, while captures are under way, a process is killed, time jumps, or
    another graph comes and goes. disks: small ones that are filled then too, by name.
    """
    result: Soak | None = None
    with ExitStack() as stack:
        before = set(_SHARED.iterdir())  # what other programs share, or have left
        stack.enter_context(ros())
        folder = Path(stack.enter_context(TemporaryDirectory()))
        (folder / 'pictures').mkdir()
        extract_captures(bag, folder / 'pictures')
        address, _ = stack.enter_context(served(folder / 'pictures', '--empty', '--delay', '0'))
        truth = Truth.load(bag / 'truth.json')
        parameters: dict[str, dict[str, Any]] = {
            'lytro_driver': {'address': address.text, 'delete': True},
            'subaperture_node': {'calibration': str(CALIBRATION), 'white': str(WHITE)},
            'dlv_node': {}, 'pmcl_node': {
                'object': str(object_in(bag)),
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
                       Disturbances(graph, second, disks),
                       set(_evenly(max(captures // 20, 1), captures, disturbances)))
            for last in _evenly(min(max(captures // 10, 4), captures), captures, _PARTS):
                run.take(last)
                run.measure()
            shared = set().union(*map(shared_files, graph.processes.values()))
            shared -= files_shared_without(graph.processes.values())
            result = run.result()
        result.status, result.tracebacks = graph.status, graph.log.count('Traceback')
        write_file(log, graph.log)
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
                self._await(lambda: len(self._answers) - self._finished() < UNDER_WAY)
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


def _in_small_disks() -> bool:
    """Whether the disks that would be filled are the small ones of `_MOUNTED`."""
    room = os.statvfs(_SHARED)
    return _LOGS.is_mount() and room.f_blocks * room.f_frsize <= _SMALL


def _mount_small_disks() -> None:
    """Become the same command in mounts of its own. Raises GraphError where that cannot be."""
    alone = ['unshare', '--mount']
    if shutil.which('unshare') is None or subprocess.run([*alone, 'true'], check=False,
                                                         capture_output=True).returncode:
        raise GraphError('--full-disks mounts disks of its own: it needs unshare (util-linux) and '
                         'root, in a container with the capability SYS_ADMIN')
    os.execvp('unshare', [*alone, 'sh', '-c', _MOUNTED, 'sh', sys.executable, '-m',
                          'pmcl_ros.evaluation.bench.soak', *sys.argv[1:]])


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog='pmcl_soak', description=__doc__)
    parser.add_argument('--captures', type=int, default=500)
    parser.add_argument('--processes', action='store_true', help='a process for each node')
    parser.add_argument('--flood', action='store_true', help='captures come faster than they can '
                        'be used: some are dropped, and all that are must be reported')
    parser.add_argument('--disturbances', type=int, default=0, metavar='N', help='with '
                        '--processes: N times a node is killed, time jumps, or a second graph '
                        'comes and goes; with --full-disks a disk is full')
    parser.add_argument('--full-disks', action='store_true', help='with --disturbances, as root: '
                        'the graph has a /dev/shm of 64 MB and a disk of 8 MB for its '
                        'logs, and each is filled now and then')
    parser.add_argument('--quick', action='store_true', help='small volumes, hardly any search')
    parser.add_argument('--bag', type=Path, default=BAG,
                        help='what the camera sees, with its truth.json and models/NAME.obj')
    parser.add_argument('--out', type=Path, default=Path('out') / 'soak',
                        help='folder for soak.json, soak.md and graph.log')
    parser.add_argument('--force', action='store_true',
                        help='overwrite files that are there already')
    options = parser.parse_args()
    if options.disturbances < 0 or (options.disturbances and not options.processes):
        parser.error('--disturbances is a number of times and needs --processes: a node is killed '
                     'by its process')
    if options.full_disks and not options.disturbances:
        parser.error('--full-disks is among the disturbances and needs --disturbances N')
    began = time_ns()
    try:
        if options.full_disks and not _in_small_disks():
            _mount_small_disks()
        own_domain()
        with Results(options.out, 'soak', options.force) as out:
            log, page, record = (out.path(name) for name in
                                 ('graph.log', 'soak.md', 'soak.json'))
            result = soak(options.captures, options.bag,
                          ['--processes'] if options.processes else [],
                          options.quick, options.flood, log, options.disturbances, {
                              'shared memory is full': _SHARED, 'the disk is full': _LOGS,
                          } if options.full_disks else {})
            violations = result.violations(options.flood)
            report = [result.markdown(), '', *(violations or ['All as it must be.'])]
            write_file(page, '\n'.join(report) + '\n')
            write_file(record, json.dumps(
                asdict(result) | {'violations': violations, 'arguments': sys.argv[1:],
                                  'began_ns': began, 'processors': os.cpu_count()}, indent=1))
    except PmclError as error:
        _CONSOLE.print(f'pmcl_soak: {error}', markup=False, soft_wrap=True)
        return 1
    Console().print('\n'.join(report), markup=False, soft_wrap=True)
    return int(bool(violations))


if __name__ == '__main__':
    sys.exit(main())
