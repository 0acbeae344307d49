"""How fast this machine is at most: multiply-adds and copies, by all of numba's threads."""

import numpy as np
from numba import get_num_threads, prange

from pmcl_ros.evaluation.bench.result import best_ms
from pmcl_ros.runtime.kernels import LOCK, compiled

_LANES = 4096      # numbers of a thread, 16 KB: near the core
_ROUNDS = 2000     # 2 ms: some run falls between what else the machine does
_STEPS = 16        # multiply-adds of a number in a row; neighbours run beside it
_COPIED = 16 << 20  # numbers of a thread, 64 MB: beyond any cache


def multiply_adds(repeats: int = 200) -> float:
    """float32 multiply-adds a second, the most of several runs; a vector of n counts as n."""
    threads = get_num_threads()
    values = np.ones((threads, _LANES), np.float32)
    factor, summand = np.float32(0.5), np.float32(0.25)

    def run() -> None:
        with LOCK:
            _multiply_add(values, factor, summand, _ROUNDS)

    run()  # compiles
    return threads * _LANES * _ROUNDS * _STEPS / best_ms(run, repeats) * 1e3


def copied_bytes(repeats: int = 5) -> float:
    """Bytes read and written a second, the most of several runs: a byte copied counts as two."""
    threads = get_num_threads()
    source, target = np.ones((2, threads, _COPIED), np.float32)

    def run() -> None:
        with LOCK:
            _copy(source, target)

    run()
    return 2 * source.nbytes / best_ms(run, repeats) * 1e3


@compiled(parallel=True)
def _multiply_add(values, factor, summand, rounds):  # type: ignore[no-untyped-def]
    for thread in prange(len(values)):
        lanes = values[thread]
        for _ in range(rounds):
            for i in range(len(lanes)):
                v = lanes[i]
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                v = v * factor + summand
                lanes[i] = v * factor + summand


@compiled(parallel=True)
def _copy(source, target):  # type: ignore[no-untyped-def]
    for thread in prange(len(source)):
        target[thread] = source[thread]
