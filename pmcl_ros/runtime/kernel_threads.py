"""The threads that share the loops of kernels."""

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

from numba import config

# One caller at a time has the threads, and the rooms that they draw in.
LOCK = threading.RLock()

_MOST = 8  # threads: a search starts loops a thousand times, and each thread adds some 20 us
CORES: int = min(config.NUMBA_NUM_THREADS, _MOST)  # type: ignore[attr-defined]
_threads = CORES


class Threads:
    """A kernel whose loop is divided among threads. It is called without the portion.

    numba's own parallel loops (prange) would compile each kernel, and all it calls, three times.
    """

    def __init__(self, kernel: Callable[..., Any]) -> None:
        self._kernel = kernel

    def __call__(self, *arguments: Any) -> list[Any]:
        """What each portion returns."""
        return self.together([arguments])[0]

    def together(self, calls: Sequence[tuple[Any, ...]]) -> list[list[Any]]:
        """What each portion of each of several calls returns; one wait for all of them.

        A thread's portion differs from call to call, so that calls of a single round are divided
        among the threads too.
        """
        with LOCK:
            number = threads()

            def share(thread: int) -> list[Any]:
                return [self._kernel(*arguments, ((thread + k) % number, number))
                        for k, arguments in enumerate(calls)]

            others = [_pool().submit(share, thread) for thread in range(1, number)]
            try:
                first = share(0)
            finally:
                for each in others:
                    each.exception()  # waits: they write into the arguments
            made = [first, *(each.result() for each in others)]
        return [[made[(portion - k) % number][k] for portion in range(number)]
                for k in range(len(calls))]


def threads() -> int:
    """The number of threads that share the loops of parallel kernels."""
    return _threads


def set_threads(number: int) -> None:
    """So many, in this process; at most, and by default, `CORES`."""
    global _threads
    _threads = min(number, CORES)


@lru_cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(CORES, 'kernel')


os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has no threads
