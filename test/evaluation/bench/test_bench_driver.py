import pytest

from pmcl_ros.evaluation.bench.driver import bench_driver


@pytest.fixture(scope='module')
def bench():
    return bench_driver(captures=12, drop='1MB', side=1000)


def test_every_capture_is_one_intact_frame(bench):
    assert (bench.captures, bench.frames, bench.intact) == (12, 12, 12)


def test_nothing_grows(bench):
    assert all(abs(each) <= 2 for each in bench.descriptor_growth.values())
    assert all(each < 8 for each in bench.memory_growth.values())  # MB; a picture has 1.5


def test_a_clean_link_is_faster(bench):
    rates = bench.megabytes_per_second
    assert rates['clean'] > rates['dropping'] > 0
