"""From raw bytes to a pose: what is timed is what `pmcl localize` does."""

from pathlib import Path

import pytest

from pmcl_ros.evaluation.bench.chain import bench_chain
from pmcl_ros.runtime.errors import SettingsError


def test_the_chain_finds_the_glass_and_times_add_up():
    result = bench_chain(repeats=1)
    assert set(result.ms) == {'decode', 'evidence', 'pose', 'total'}
    stages = sum(result.ms[each] for each in ('decode', 'evidence', 'pose'))
    assert stages == pytest.approx(result.ms['total'])
    assert result.error_mm < 3
    assert result.evaluations > 1000
    assert result.ratio_to_wanted == {'pose': result.ms['pose'] / 1000,
                                      'total': result.ms['total'] / 1500}
    assert 'raw picture to a pose' in result.lines()[0]


def test_without_the_sources_it_says_so(tmp_path):
    with pytest.raises(SettingsError, match=r'there is no .*nothing: this bench wants a checkout'):
        bench_chain(bag=Path(tmp_path / 'nothing'))
