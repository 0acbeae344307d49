"""What is timed is many times as fast as its plain form."""

import numpy as np
import pytest

from pmcl_ros.evaluation.bench.decode import bench_decode
from pmcl_ros.evaluation.bench.dlv import bench_dlv
from pmcl_ros.evaluation.bench.timing import Bench, best_ms


def test_the_least_time_counts():
    waits = iter([3, 0, 2])
    assert best_ms(lambda: np.zeros(next(waits) * 10 ** 6).sum(), 3) < 1000


@pytest.mark.usefixtures('all_threads')
def test_the_decode_is_many_times_as_fast_as_its_plain_form():
    result = bench_decode(repeats=2, side=1640)
    assert isinstance(result, Bench)
    assert set(result.ms) == {'unpack', 'sample', 'resample', 'total', 'reference'}
    assert result.ratio_to_reference > 5
    assert 25 < result.mb['decode'] < 50  # the views alone are 26


@pytest.mark.parametrize(('back_end', 'side', 'stages', 'least'), [
    ('numba', 164, ['sweep'], 20), ('gl', 64, ['upload', 'resident', 'read'], 1)])
@pytest.mark.usefixtures('all_threads')
def test_the_volume_is_faster_than_its_plain_form(back_end, side, stages, least):
    result = bench_dlv(repeats=1, wanted=back_end, side=side)
    assert list(result.ms) == ['views', 'planes', *stages, 'total', 'edges', 'layers', 'plain']
    assert min(result.ms.values()) > 0
    assert result.ratio_to_reference == result.ms['plain'] / result.ms['total'] > least
    assert result.geometry.endswith(f'by {back_end}')
    assert result.lines()[-1].endswith('times as fast as the plain form')
