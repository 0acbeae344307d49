"""The benches' plain forms work on the same, and give nearly the same, as what is timed."""

import cv2
import numpy as np
import pytest

from pmcl_ros.dlv.cost import cost_volume, likelihood_volume
from pmcl_ros.dlv.cost_inputs import CostInputs
from pmcl_ros.dlv.planes import ENCODING
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.bench import Bench, bench_decode, bench_dlv, plain_dlv
from pmcl_ros.evaluation.bench.dlv import least_work
from pmcl_ros.evaluation.bench.machine import copied_bytes, multiply_adds
from pmcl_ros.evaluation.bench.result import best_ms
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions


def test_the_least_time_counts():
    waits = iter([3, 0, 2])
    assert best_ms(lambda: np.zeros(next(waits) * 10 ** 6).sum(), 3) < 1000


def test_the_decode_is_many_times_as_fast_as_its_plain_form():
    result = bench_decode(repeats=3)
    assert isinstance(result, Bench)
    assert set(result.ms) == {'unpack', 'sample', 'resample', 'total', 'reference'}
    assert result.ratio_to_reference > 5
    assert 100 < result.mb['decode'] < 200  # the views alone are 105


@pytest.mark.parametrize(('back_end', 'side', 'stages', 'least'), [
    ('numba', 328, ['sweep'], 20), ('gl', 128, ['upload', 'resident', 'read'], 1)])
def test_the_volume_is_faster_than_its_plain_form(back_end, side, stages, least):
    result = bench_dlv(repeats=1, wanted=back_end, side=side)
    assert list(result.ms) == ['views', 'planes', *stages, 'total', 'edges', 'layers', 'plain',
                               'bound']
    assert min(result.ms.values()) > 0
    assert result.ratio_to_reference == result.ms['plain'] / result.ms['total'] > least
    assert result.ratio_to_bound == result.ms['total'] / result.ms['bound']
    assert result.geometry.endswith(f'by {back_end}')
    assert result.lines()[-1].endswith('times the least time for this machine')


def test_the_plain_volume_is_nearly_the_same():
    grid = ViewGrid(Pinhole(60, 50, 945, 945, 29.5, 24.5), 0.00074, nominal_positions(3, 3),
                    np.ones((3, 3), np.float32))
    smooth = cv2.GaussianBlur(np.random.default_rng(0).random((50, 60, 27), np.float32), (0, 0), 2)
    counts = np.ascontiguousarray(
        (255 * smooth).astype(np.uint8).reshape(50, 60, 3, 3, 3).transpose(2, 3, 0, 1, 4))
    settings = DlvSettings(interpolation='bilinear')
    depths = depth_labels(0.39, 0.71, 7)
    plain = plain_dlv.costs(*plain_dlv.channels(counts), grid, depths, settings)
    field = LightField(Header(), (counts / np.float32(255)) ** np.float32(1 / ENCODING), grid)
    inside = (slice(None), slice(8, -8), slice(8, -8))  # it knows no borders
    exact = cost_volume(field, depths, settings)
    np.testing.assert_allclose(plain[inside], exact[inside], rtol=0.02)
    exact = likelihood_volume(field, depths, settings)[8:-8, 8:-8]
    np.testing.assert_allclose(plain_dlv.log_likelihood(plain)[8:-8, 8:-8], exact,
                               atol=0.02 * exact.max())


def work(labels=20, size=(40, 30), baseline=0.001, **options):
    """Of a row of three views; 1 mm, 100 px: 0.3 px at the nearest."""
    width, height = size
    grid = ViewGrid(Pinhole(width, height, 100, 100, 0, 0), baseline, nominal_positions(1, 3),
                    np.ones((1, 3), np.float32))
    field = LightField(Header(), np.ones((1, 3, height, width, 3), np.float32), grid)
    settings = DlvSettings(**options)
    return least_work(CostInputs.of(field, depth_labels(0.3, 0.9, labels), settings), settings)


def test_the_least_work_by_hand():
    # A pair's samples leave the image at one column. One run, three nodes.
    area = 2 * 39 * 30
    operations = area * (3 * 5 * 14 + 5 * 8 + 20 * 20) + 20 * 40 * 30 * 19
    np.testing.assert_array_equal(work(), [operations, 3 * 3 * 40 * 30 + 4 * 20 * 40 * 30])
    without_root = operations - area * 20 * 2
    assert work(color_cost='sad')[0] == without_root
    assert work(window=1)[0] == operations - 4 * 20 * 40 * 30


def test_the_least_work_counts_a_node_once_that_two_runs_share():
    # 20 mm: 2.2 to 6.7 px, five runs of less than a pixel; seven columns leave the image.
    area = 2 * 33 * 30
    operations = area * (11 * 5 * 14 + 5 * 5 * 8 + 20 * 40) + 40 * 40 * 30 * 19
    assert work(labels=40, baseline=0.02)[0] == operations


def test_a_machine_is_at_least_as_fast_as_numpy_on_one_core():
    values, factor, summand = np.ones(4096, np.float32), np.float32(0.5), np.float32(0.25)
    source, target = np.ones((2, 1 << 24), np.float32)

    def arithmetic():
        ms = best_ms(lambda: [values * factor + summand for _ in range(100)], 20)
        return multiply_adds() > 100 * values.size / ms * 1e3

    def copies():
        ms = best_ms(lambda: np.copyto(target, source), 5)
        return copied_bytes() > 0.5 * 2 * source.nbytes / ms * 1e3

    # Whatever else runs on the machine meanwhile slows one side or the other.
    assert any(arithmetic() for _ in range(10))
    assert any(copies() for _ in range(10))
