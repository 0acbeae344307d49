"""Jobs done in several processes, or in this one: the same trials, in whatever order."""

import contextlib
import multiprocessing
import os
import signal
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.synchronize import Event
from pathlib import Path

import numba

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evaluation.shared import Shared
from pmcl_ros.evaluation.trials import Job, Trial, Worker
from pmcl_ros.runtime.errors import PmclError

_LOOK = 0.2  # s: so often it is asked whether to stop
_AHEAD = 2  # batches whose volumes are on disk at once: one worked on, one for when it is done


@dataclass(frozen=True)
class Batch:
    """Jobs on one volume."""

    volume: Shared[DepthLikelihoodVolume]
    jobs: tuple[Job, ...]


MakeBatches = Callable[[Path], Iterable[Batch]]


def run_batches(make: MakeBatches, processes: int, stopped: Callable[[], bool] = lambda: False
                ) -> Generator[Trial, None, None]:
    """All trials, each as soon as it is done.

    make: yields the batches, whose volumes it writes into the folder it is given. They are asked
    for only shortly before they are needed, and deleted afterwards.
    processes: 1: in this process and thread, one after the other.
    stopped: asked again and again; once it is true the iterator ends. Searches that are under way
    then, or when the iterator is closed, are stopped and not counted. (A KeyboardInterrupt that
    comes in the middle of a compiled loop would leave it with another exception.)
    """
    with tempfile.TemporaryDirectory(prefix='pmcl_evaluate_') as folder:
        batches = make(Path(folder))
        if processes == 1:
            yield from _one_after_the_other(batches, stopped)
        else:
            yield from _side_by_side(batches, processes, stopped)


def _one_after_the_other(batches: Iterable[Batch], stopped: Callable[[], bool]
                         ) -> Iterator[Trial]:
    with contextlib.closing(Worker(stopped)) as worker:
        for batch in batches:
            for job in batch.jobs:
                trial = None if stopped() else worker.run(job)
                if trial is None:
                    return
                yield trial
            batch.volume.path.unlink()


def _side_by_side(batches: Iterable[Batch], processes: int, stopped: Callable[[], bool]
                  ) -> Iterator[Trial]:
    # Spawned, not forked: numba's and GL's threads do not survive a fork.
    context = multiprocessing.get_context('spawn')
    stop = context.Event()
    threads = max(1, (os.cpu_count() or 1) // processes)
    pool = ProcessPoolExecutor(processes, context, _start, (stop, threads))
    try:
        with _ignored(signal.SIGINT):  # inherited: Ctrl-C reaches this process alone
            for _ in range(processes):
                pool.submit(os.getpid)
        pending: dict[Future[Trial | None], Batch] = {}
        for batch in batches:
            pending |= {pool.submit(_run, job): batch for job in batch.jobs}
            while len({each.volume.path for each in pending.values()}) >= _AHEAD:
                yield from _done(pending)
                if stopped():
                    return
        while pending and not stopped():
            yield from _done(pending)
    except BrokenProcessPool:
        raise PmclError(f'one of {processes} processes was killed, probably for want of memory: '
                        'use fewer processes') from None
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def _done(pending: dict[Future[Trial | None], Batch]) -> Iterator[Trial]:
    """Wait a while for results; take them out of `pending`, delete volumes used up.

    What failed is raised after what succeeded was yielded.
    """
    finished, _ = wait(pending, _LOOK, FIRST_COMPLETED)
    for future in sorted(finished, key=lambda each: each.exception() is not None):
        volume = pending.pop(future).volume
        if all(each.volume.path != volume.path for each in pending.values()):
            volume.path.unlink()
        trial = future.result()
        if trial is not None:
            yield trial


@contextlib.contextmanager
def _ignored(number: signal.Signals) -> Iterator[None]:
    before = signal.signal(number, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(number, before)


_WORKERS: list[Worker] = []  # the one of this process


def _start(stop: Event, threads: int) -> None:
    """First thing in a process of the pool: it shares the cores with the others."""
    os.environ['LP_NUM_THREADS'] = str(threads)  # of Mesa's renderer on the processor
    numba.set_num_threads(min(threads, numba.get_num_threads()))
    _WORKERS.append(Worker(stop.is_set))


def _run(job: Job) -> Trial | None:
    return _WORKERS[0].run(job)
