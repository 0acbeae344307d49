"""Runs jobs in several processes, or in this one: the same trials, in whatever order."""

import contextlib
import logging
import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.synchronize import Event

from pmcl_ros.evaluation.named_log import log_named
from pmcl_ros.evaluation.trials import Camera, Job, Trial, Worker
from pmcl_ros.runtime import kernel_threads
from pmcl_ros.runtime.errors import PmclError

_LOG = logging.getLogger(__name__)
_POLL = 0.2  # s between two questions whether to stop


def run_jobs(jobs: Sequence[Job], camera: Camera | None, processes: int,
             stopped: Callable[[], bool] = lambda: False) -> Generator[Trial, None, None]:
    """All trials, each as soon as it is done.

    camera: as of `Worker`. processes: 1: in this process and thread, one after the other.
    stopped: asked again and again; once it is true the iterator ends. Searches that are under way
    then, or when the iterator is closed, are stopped and not counted. (A KeyboardInterrupt that
    comes in the middle of a compiled loop would leave it with another exception.)
    Messages of the log begin with the name of the capture.
    Raises SettingsError for a row's impossible settings. A capture that fails is logged, and the
    others go on; after them PmclError says which failed.
    """
    for job in {each.variant: each for each in jobs}.values():
        job.variant.search(job.capture)
    outcomes = (_one_by_one(jobs, camera, stopped) if processes == 1
                else _side_by_side(jobs, camera, processes, stopped))
    failures: dict[tuple[str, str], None] = {}  # of the seeds of a capture one message suffices
    with contextlib.closing(outcomes):
        for job, outcome in outcomes:
            if isinstance(outcome, Trial):
                yield outcome
            elif (each := (job.capture.name, str(outcome))) not in failures:
                failures[each] = None
                _LOG.error('%s: %s', *each)
    if failures and not stopped():
        failed = sorted({name for name, _ in failures})
        count = len({each.capture.name for each in jobs})
        raise PmclError(f'{len(failed)} of {count} captures failed, as said above: '
                        f'{", ".join(failed)}')


_Outcomes = Generator[tuple[Job, Trial | PmclError], None, None]


def _one_by_one(jobs: Sequence[Job], camera: Camera | None, stopped: Callable[[], bool]
                ) -> _Outcomes:
    with contextlib.closing(Worker(camera, stopped)) as worker:
        for job in jobs:
            outcome = None if stopped() else _outcome(worker, job)
            if outcome is None:
                return
            yield job, outcome


def _side_by_side(jobs: Sequence[Job], camera: Camera | None, processes: int,
                  stopped: Callable[[], bool]) -> _Outcomes:
    # Spawned, not forked: GL's threads do not survive a fork.
    context = multiprocessing.get_context('spawn')
    stop = context.Event()
    threads = max(1, (os.cpu_count() or 1) // processes)
    pool = ProcessPoolExecutor(processes, context, _start, (camera, stop, threads))
    try:
        with _ignored(signal.SIGINT):  # inherited: Ctrl-C reaches this process alone
            for _ in range(processes):
                pool.submit(os.getpid)
        of = {pool.submit(_run, job): job for job in jobs}
        pending = set(of)
        while pending and not stopped():
            finished, pending = wait(pending, _POLL, FIRST_COMPLETED)
            # What raises, a process that was killed say, comes after what succeeded.
            for each in sorted(finished, key=lambda each: each.exception() is not None):
                outcome = each.result()
                if outcome is not None:
                    yield of[each], outcome
    except BrokenProcessPool:
        raise broken_pool(processes) from None
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def _outcome(worker: Worker, job: Job) -> Trial | PmclError | None:
    """None: it was stopped."""
    try:
        with log_named(job.capture.name):
            return worker.run(job)
    except PmclError as error:
        return error


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


def _run(job: Job) -> Trial | PmclError | None:
    return _outcome(_WORKERS[0], job)
