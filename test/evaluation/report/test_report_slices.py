"""Slices of a light field and its volume that shows planes at known depths."""

import numpy as np
import pytest
from dlv_fields import make_grid, planes_field
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evaluation.report.slices import epipolar_slice, label_at, track, volume_slice

FAR, NEAR, SPLIT = 0.8, 0.5, 34
GRID = make_grid(views=(7, 7), size=(70, 60), baseline=0.005, jitter=0.1)
FIELD = planes_field(GRID, FAR, NEAR, SPLIT)


def slope_of(epi, low, high):
    """px per view step that patterns move in an epipolar slice, from its brightness alone."""
    grey = epi.pixels[:, low:high].astype(float).mean(axis=-1)
    across = np.gradient(grey, axis=1)
    up = np.gradient(grey, epi.positions, axis=0)
    inside = np.s_[1:-1, 2:-2]
    return -(across[inside] * up[inside]).sum() / (across[inside] ** 2).sum()


@pytest.mark.parametrize(('along', 'pixel', 'reach', 'depth'), [
    ('x', 25, (2, 28), FAR), ('x', 40, (42, 68), NEAR),
    ('y', 15, (2, 58), FAR), ('y', 55, (2, 58), NEAR)])
def test_lines_lean_as_what_lies_at_their_depth(along, pixel, reach, depth):
    epi = epipolar_slice(FIELD, along, pixel)
    assert epi.pixels.shape == (7, 70 if along == 'x' else 60, 3)
    line = track(GRID, along, 30.0, depth, epi.positions)
    assert line[3] == pytest.approx(30)  # the centre view's own pixel
    slope = np.polyfit(epi.positions, line, 1)[0]
    assert slope_of(epi, *reach) == pytest.approx(slope, rel=0.06)
    # Another depth's line leans otherwise by far more than that.
    other = np.polyfit(epi.positions, track(GRID, along, 30.0, FAR + NEAR - depth,
                                            epi.positions), 1)[0]
    assert abs(other / slope - 1) > 0.3


@settings(max_examples=25)
@given(st.sampled_from('xy'), st.floats(0, 60), st.floats(0.3, 3))
def test_a_track_is_where_the_views_project_a_point(along, pixel, depth):
    axis = 'xy'.index(along)
    focal = (GRID.pinhole.fx, GRID.pinhole.fy)[axis]
    centre = (GRID.pinhole.cx, GRID.pinhole.cy)[axis]
    positions = np.linspace(-3, 3, 5)
    point = (pixel - centre) / focal * depth - positions * GRID.baseline
    np.testing.assert_allclose(track(GRID, along, pixel, depth, positions),
                               focal * point / depth + centre, atol=1e-9)


@pytest.fixture(scope='module')
def volume():
    return build_volume(FIELD, DlvSettings(near=0.4, far=1.0, labels=40, edge_labels=4))


@pytest.mark.parametrize(('part', 'depth'), [(np.s_[6:26], FAR), (np.s_[42:64], NEAR)])
def test_slices_are_brightest_at_the_planes_depth(volume, part, depth):
    wanted = label_at(volume.depths, depth)
    for row in (20, 40):
        seen = volume_slice(volume, 'x', row)
        assert seen.shape == (40, 70)  # the first row is the farthest label
        assert np.abs(seen[:, part].sum(axis=1).argmax() - wanted) <= 1
    column = (part.start + part.stop) // 2
    side = volume_slice(volume, 'y', column)
    assert side.shape == (60, 40)  # the first column is the nearest label
    assert np.abs(39 - side[5:-5].sum(axis=0).argmax() - wanted) <= 1
