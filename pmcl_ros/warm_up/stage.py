"""Compiles the kernels of stages, on all cores, with a progress line."""

import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from multiprocessing import get_context
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from pmcl_ros.runtime import kernels
from pmcl_ros.runtime.errors import PmclError

_LINE_EVERY = 5.0  # s: between lines where the output is a log, not a terminal


class Stage(NamedTuple):
    """Compiles kernels, by running on little data what calls them.

    kernels: what the names of those begin with.
    """

    run: Callable[[], None]
    kernels: tuple[str, ...]

    def mark(self, folder: Path) -> Path:
        """The file that says that all its kernels, as they are now, are in a folder."""
        return folder / f'{self.run.__qualname__}.{kernels.digest(self.kernels)}.complete'


Stages = tuple[Stage, ...]


def compile_ahead(console: Console, stages: Stages) -> None:
    """Compile the kernels that are not on disk yet, on all cores, with a progress line.

    Where all are, and where none can be kept, this takes milliseconds and prints nothing.
    Call it before there are threads: it forks. Raises PmclError where a process is killed.
    """
    folder = kernels.cache_folder()
    if folder is None:
        return
    missing = [each for each in stages if not each.mark(folder).exists()]
    names = tuple(name for each in missing for name in each.kernels)
    started, (before, total) = time.monotonic(), kernels.progress(names)
    if not total:  # nothing is missing, or numba is switched off
        return
    fork = get_context('fork')
    begun: SimpleQueue[str] = fork.SimpleQueue()
    columns = TextColumn('compiling kernels'), BarColumn(), MofNCompleteColumn(), TextColumn(
        '{task.description}')
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), fork, _begin, (begun,)) as pool:
        # Processes are forked before the progress line starts its thread.
        futures = [pool.submit(each.run) for each in missing]
        bar = Progress(*columns, console=console, transient=True)
        # Elsewhere than in a terminal even a disabled bar ends with an empty line.
        with bar if console.is_terminal else nullcontext():
            task = bar.add_task('', total=total)
            line, name = started, ''
            while wait(futures, 0.2).not_done:
                while not begun.empty():
                    name = begun.get()
                count, _ = kernels.progress(names)
                bar.update(task, completed=count, description=name)
                if name and not console.is_terminal and time.monotonic() > line:
                    console.print(f'compiling kernels: {count} of {total}, {name}')
                    line = time.monotonic() + _LINE_EVERY
        try:
            for each in futures:
                each.result()
        except BrokenProcessPool:
            raise PmclError('a process that compiled kernels was killed, probably for lack of '
                            'memory; start again: what is compiled is kept') from None
    for stage in missing:
        stage.mark(folder).touch()
    if count := kernels.progress(names)[0] - before:
        console.print(f'compiled {count} kernels in {time.monotonic() - started:.0f} s',
                      highlight=False)


def _begin(names: 'SimpleQueue[str]') -> None:
    """In each process: report which kernel is being compiled; end at once by Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    kernels.report_to(names.put)
