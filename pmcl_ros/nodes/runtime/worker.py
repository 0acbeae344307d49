"""A thread that owns an object which no other thread may touch, such as a GL context."""

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import partial
from typing import Generic, Protocol, TypeVar


class Closeable(Protocol):
    """An object with a `close` method."""

    def close(self) -> None:
        """Release all."""


T = TypeVar('T', bound=Closeable)
Job = partial[None]  # called with the object


class Worker(Generic[T]):
    """Runs jobs on the object that `make` returns; one job may wait, and a newer one replaces it.

    A job should end early when `stopping` is true. Raises the errors of `make`.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self.stopping = True
        self._lock = threading.Lock()
        self._waiting: Job | None = None
        self._running: Future[None] | None = None
        self._pool = ThreadPoolExecutor(1)  # never replaces its thread
        try:
            self.owned = self._pool.submit(make).result()
        except BaseException:
            self._pool.shutdown()
            raise

    def resume(self) -> None:
        """Take jobs."""
        self.stopping = False

    def offer(self, job: Job) -> Job | None:
        """Run `job` after the one that is running; the one that waited, if any, never runs."""
        with self._lock:
            replaced, self._waiting = self._waiting, job
            if self._running is None:
                self._running = self._pool.submit(self._run)
        return replaced

    def stop(self) -> Job | None:
        """End the job that runs, and return when it has ended; the one that waited never runs."""
        with self._lock:
            self.stopping = True
            waited, self._waiting = self._waiting, None
            running = self._running
        if running is not None:
            wait([running])
        return waited

    def close(self) -> None:
        """Stop, and close the thing on its own thread."""
        self.stop()
        try:
            self._pool.submit(self.owned.close).result()
        finally:
            self._pool.shutdown()

    def _run(self) -> None:
        while True:
            with self._lock:
                job, self._waiting = self._waiting, None
                if job is None:
                    self._running = None
                    return
            job(self.owned)
