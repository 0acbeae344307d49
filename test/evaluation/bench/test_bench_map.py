"""The contour map and poses by it, timed."""

import pytest

from pmcl_ros.evaluation.bench.map import bench_map
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera


def test_maps_and_poses_are_timed_with_their_parts():
    camera = OrdinaryCamera(width=240, height=200, fx=240, cx=119.5, cy=99.5)
    result = bench_map(1, ((64, 64), (320, 320)), 96, camera, ('glass',))
    small, large, light_field, pose = result.times.values()
    assert list(result.times) == ['map of 64x64 px', 'map of 320x320 px',
                                  'map of 7x7 views of 96x96 px', 'pose of glass, 240x200 px']
    assert small.ms < large.ms
    assert list(large.shares) == ['network']
    assert list(light_field.shares) == ['refocusing', 'network']
    assert list(pose.shares) == ['evidence', 'pose']
    assert sum(pose.shares.values()) == pytest.approx(1, abs=0.1)  # reading takes no time
    assert pose.error_mm < 10
    assert all(each.error_mm is None for each in (small, large, light_field))
    lines = result.lines()
    assert len(lines) == 4
    assert 'ms, CPU time' in lines[0]
    assert lines[3].endswith(f'{pose.error_mm:.1f} mm from the truth')
