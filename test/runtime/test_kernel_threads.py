"""Loops of kernels are divided among threads, each round once."""

import os
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pmcl_ros.runtime import kernel_threads
from pmcl_ros.runtime.kernel_threads import Threads
from pmcl_ros.runtime.kernels import compiled, rounds


@compiled(parallel=True)
def _count(times, where, portion):
    """Add one to each of `times`; where: who was there; fails at a negative number."""
    for n in rounds(len(times), portion):
        if times[n] < 0:
            raise ValueError('negative')
        times[n] += 1
        where[n] = portion[0]
    return portion[1]


@pytest.fixture
def use_threads(monkeypatch):
    """Kernels of the test run on so many threads, as if there were as many cores."""
    before = kernel_threads.threads()

    def use(number):
        monkeypatch.setattr(kernel_threads, 'CORES', number)
        kernel_threads.set_threads(number)

    yield use
    kernel_threads.set_threads(before)


@pytest.mark.parametrize('count', [0, 1, 2, 3, 100])
def test_each_round_of_a_loop_is_in_one_portion(count, use_threads):
    use_threads(5)
    times, where = np.zeros(count, np.int64), np.zeros(count, np.int64)
    assert _count(times, where) == [5] * 5
    np.testing.assert_array_equal(times, 1)
    assert (np.diff(where) >= 0).all()
    assert np.ptp(np.bincount(where, minlength=5)) <= 1  # none has more to do than others


def test_calls_together_are_those_one_after_the_other_by_all_threads(use_threads):
    use_threads(3)
    calls = [(np.zeros(count, np.int64), np.zeros(count, np.int64)) for count in (1, 0, 7, 1)]
    assert _count.together(calls) == [[3] * 3] * len(calls)
    for times, where in calls:
        np.testing.assert_array_equal(times, 1)
        assert (np.diff(where) >= 0).all()
    assert Threads(lambda value, portion: (value, *portion)).together([('a',), ('b',)]) == [
        [(value, number, 3) for number in range(3)] for value in 'ab']


def test_calls_of_a_single_round_are_divided_among_threads(use_threads):
    use_threads(2)
    barrier = threading.Barrier(2, timeout=30)

    def meet(portion):
        if portion[0] == 1:
            barrier.wait()  # broken, unless the other thread has such a round meanwhile

    Threads(meet).together([()] * 2)


def test_what_one_portion_raises_is_raised_when_all_have_ended(all_threads):
    times = np.zeros(1000, np.int64)
    times[-1] = -1
    with pytest.raises(ValueError, match='negative'):
        _count(times, np.zeros(1000, np.int64))
    np.testing.assert_array_equal(times[:-1], 1)


def test_several_callers_and_a_fork_have_threads(all_threads):
    def count(_):
        times = np.zeros(1000, np.int64)
        _count(times, np.zeros(1000, np.int64))
        return int(times.sum())

    with ThreadPoolExecutor(3) as pool:
        assert list(pool.map(count, range(30))) == [1000] * 30
    child = os.fork()
    if child == 0:
        os._exit(count(0) != 1000)
    assert os.waitpid(child, 0)[1] == 0
