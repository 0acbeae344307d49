"""Runs jobs in several processes, or in this one: the same trials, in whatever order."""

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.synchronize import Event

from pmcl_ros.evaluation.trials import Camera, Job, Trial, Worker
from pmcl_ros.runtime import kernel_threads
from pmcl_ros.runtime.errors import PmclError

_POLL = 0.2  # s between two questions whether to stop


def run_jobs(jobs: Sequence[Job], camera: Camera | None, processes: int,
             stopped: Callable[[], bool] = lambda: False) -> Generator[Trial, None, None]:
    """All trials, each as soon as it is done.

    camera: as of `Worker`. processes: 1: in this process and thread, one after the other.
    stopped: asked again and again; once it is true the iterator ends. Searches that are under way
    then, or when the iterator is closed, are stopped and not counted. (A KeyboardInterrupt that
    comes in the middle of a compiled loop would leave it with another exception.)
    """
    if processes == 1:
        with contextlib.closing(Worker(camera, stopped)) as worker:
            for job in jobs:
                trial = None if stopped() else worker.run(job)
                if trial is None:
                    return
                yield trial
    else:
        yield from _side_by_side(jobs, camera, processes, stopped)


def _side_by_side(jobs: Sequence[Job], camera: Camera | None, processes: int,
                  stopped: Callable[[], bool]) -> Iterator[Trial]:
    # Spawned, not forked: GL's threads do not survive a fork.
    context = multiprocessing.get_context('spawn')
    stop = context.Event()
    threads = max(1, (os.cpu_count() or 1) // processes)
    pool = ProcessPoolExecutor(processes, context, _start, (camera, stop, threads))
    try:
        with _ignored(signal.SIGINT):  # inherited: Ctrl-C reaches this process alone
            for _ in range(processes):
                pool.submit(os.getpid)
        pending = {pool.submit(_run, job) for job in jobs}
        while pending and not stopped():
            finished, pending = wait(pending, _POLL, FIRST_COMPLETED)
            # A failure is raised after the trials that succeeded.
            for each in sorted(finished, key=lambda each: each.exception() is not None):
                trial = each.result()
                if trial is not None:
                    yield trial
    except BrokenProcessPool:
        raise broken_pool(processes) from None
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def broken_pool(processes: int) -> PmclError:
    """What to raise where a pool of so many processes is broken."""
    return PmclError(f'one of {processes} processes was killed, probably for lack of memory: use '
                     'fewer processes')


@contextlib.contextmanager
def _ignored(number: signal.Signals) -> Iterator[None]:
    before = signal.signal(number, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(number, before)


_WORKERS: list[Worker] = []  # the one of this process


def _start(camera: Camera | None, stop: Event, threads: int) -> None:
    """Prepare a process of the pool: it shares the cores with the others."""
    os.environ['LP_NUM_THREADS'] = str(threads)  # of Mesa's renderer on the processor
    kernel_threads.set_threads(min(threads, kernel_threads.threads()))
    _WORKERS.append(Worker(camera, stop.is_set))


def _run(job: Job) -> Trial | None:
    return _WORKERS[0].run(job)
