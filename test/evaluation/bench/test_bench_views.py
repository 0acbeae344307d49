"""Views that come one after the other, timed."""

import numpy as np

from pmcl_ros.evaluation.bench.views import bench_views
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera


def test_a_further_view_takes_less_than_a_search():
    small = OrdinaryCamera(width=240, height=200, fx=240, cx=119.5, cy=99.5)
    result = bench_views(2, small, kinds=('glass',))
    times = result.kinds['glass']
    assert len(times.evidence) == len(times.whole) == len(times.further) == 2
    assert times.further[1] < times.whole[1]
    assert max(times.error_mm) < 10
    assert np.ptp(times.error_mm) < 2
    assert result.lines()[0] == ('2 views of 240x200 px over 60 degrees, objects said to be '
                                 'clear')
    assert len(result.lines()) == 2 + 2 + 1
    assert 100 < times.peak < 1e5
