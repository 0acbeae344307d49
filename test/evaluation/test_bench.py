"""The benches' plain forms work on the same, and give nearly the same, as what is timed."""

import numpy as np

from pmcl_ros.evaluation.bench import Bench, bench_decode
from pmcl_ros.evaluation.bench.result import best_ms


def test_the_least_time_counts():
    waits = iter([3, 0, 2])
    assert best_ms(lambda: np.zeros(next(waits) * 10 ** 6).sum(), 3) < 1000


def test_the_decode_is_many_times_as_fast_as_its_plain_form():
    result = bench_decode(repeats=3)
    assert isinstance(result, Bench)
    assert set(result.ms) == {'unpack', 'sample', 'resample', 'total', 'reference'}
    assert result.ratio_to_reference > 5
    assert 100 < result.mb['decode'] < 200  # the views alone are 105
