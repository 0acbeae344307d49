"""The fast cost volume against the plain one, and the plain one against what it should be."""

import numpy as np
import pytest
from dlv_fields import make_grid, noise_field, planes_field
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.dlv import reference
from pmcl_ros.dlv.cost import cost_volume
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.runs import Runs
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.lightfield.light_field import LightField


def assert_same(field, options, depths):
    fast = cost_volume(field, depths, options)
    plain = reference.cost_volume(field, depths, options)
    assert fast.dtype == np.float32
    samples = len(StereoPairs.of(field.grid, options.views).indices) * options.window ** 2
    np.testing.assert_allclose(fast, plain, rtol=1e-5, atol=2e-6 * samples)
    return (fast.argmax(0) == plain.argmax(0)).mean(), (fast.argmin(0) == plain.argmin(0)).mean()


@pytest.mark.parametrize('window', [1, 3, 5])
@pytest.mark.parametrize('color_cost', ['l2', 'sad'])
@pytest.mark.parametrize(('views', 'size', 'baseline', 'jitter'), [
    ((3, 3), (24, 20), 0.001, 0),  # within one cell
    ((7, 7), (33, 29), 0.006, 0),  # the proportions of a capture: 0.7 to 2 px for each step
    ((5, 7), (31, 17), 0.006, 0.05),  # as measured positions are
    ((1, 5), (40, 9), 0.03, 0.3),  # up to 20 px, rows not in line
])
def test_fast_cost_is_the_reference(views, size, baseline, jitter, color_cost, window):
    field = noise_field(make_grid(views, size, baseline, jitter))
    options = DlvSettings(color_cost=color_cost, window=window)
    worst, best = assert_same(field, options, depth_labels(0.3, 0.9, 25))
    assert worst > 0.999
    assert best > 0.999


@settings(max_examples=25, deadline=None)
@given(width=st.integers(1, 50), height=st.integers(1, 40), rows=st.sampled_from([1, 3]),
       columns=st.sampled_from([3, 5]), window=st.sampled_from([1, 3, 7]),
       beta=st.floats(0, 1), tau=st.floats(0.01, 2), labels=st.integers(2, 40),
       step=st.floats(0.01, 0.99), jitter=st.floats(0, 0.3), seed=st.integers(0, 99))
def test_fast_cost_is_the_reference_whatever_the_shape(
        width, height, rows, columns, window, beta, tau, labels, step, jitter, seed):
    # `step`: the largest displacement as a part of what the image allows.
    grid = make_grid((rows, columns), (width, height), 1, jitter, focal=(1, 1), seed=seed)
    reach = np.abs(grid.positions).max(axis=(0, 1))
    near = (reach / (width, height)).max() / step
    field = noise_field(grid, seed)
    options = DlvSettings(window=window, beta=beta, tau_color=tau, tau_gradient=tau)
    assert_same(field, options, depth_labels(near, 4 * near, labels))


def test_rows_longer_than_a_tile():
    field = noise_field(make_grid((3, 3), (701, 5), 0.006))
    worst, best = assert_same(field, DlvSettings(), depth_labels(0.3, 0.9, 7))
    assert worst > 0.999
    assert best > 0.999


def test_views_may_be_strided_or_double():
    grid = make_grid()
    views = np.random.default_rng(1).random((3, 3, 20, 24, 3))
    depths = depth_labels(0.3, 0.9, 5)
    expected = cost_volume(LightField(noise_field(grid).header, views.astype(np.float32), grid),
                           depths, DlvSettings())
    mirrored = np.ascontiguousarray(views[:, :, ::-1])[:, :, ::-1]
    for odd in (views, mirrored.astype(np.float32)):
        field = LightField(noise_field(grid).header, odd, grid)
        np.testing.assert_array_equal(cost_volume(field, depths, DlvSettings()), expected)


def test_runs_cover_every_label_once_and_stay_in_their_cell():
    depths = depth_labels(0.3, 0.9, 75)
    positions = make_grid((3, 7), jitter=0.05).positions.reshape(-1, 1, 2)
    shifts = -0.5 * positions / depths[:, None]
    runs = Runs.of(shifts, depths)
    seen = np.zeros(shifts.shape[:2], int)
    for (pair, first, end, *cell), origin, slope in zip(
            runs.where, runs.origin, runs.slope, strict=True):
        seen[pair, first:end] += 1
        place = origin + runs.time[pair, first:end, None] * slope
        assert (place > -1e-5).all()
        assert (place < 1 + 1e-5).all()
        np.testing.assert_allclose(cell + place, shifts[pair, first:end], atol=1e-5)
    assert (seen == 1).all()


def test_window_sum_is_cut_off_at_the_border():
    total = reference.window_sum(np.ones((1, 4, 5)), 3)
    np.testing.assert_array_equal(total[0], [[4, 6, 6, 6, 4], [6, 9, 9, 9, 6], [6, 9, 9, 9, 6],
                                             [4, 6, 6, 6, 4]])


@pytest.mark.parametrize(('color_cost', 'colour'), [('l2', 0.06 * np.sqrt(3)), ('sad', 0.18)])
def test_reference_by_hand(color_cost, colour):
    # Two views: a ramp of 0.02 per px along x, seen brighter by 0.06, does not change along y.
    grid = make_grid((1, 3), (16, 12), 0.01, focal=(1, 1))
    ramp = 0.1 + 0.02 * np.arange(16)
    views = np.broadcast_to(ramp[:, None], (1, 3, 12, 16, 3)).astype(np.float32).copy()
    views[0, 0] += 0.06
    views[0, 2] += 0.06
    field = LightField(noise_field(grid).header, views, grid, gamma=1)
    options = DlvSettings(color_cost=color_cost, window=3, beta=0.7)
    cost = reference.cost_volume(field, np.array([1e6, 2e6]), options)
    np.testing.assert_allclose(cost[:, 5, 8], 0.7 * 2 * 9 * colour, rtol=1e-4)
    options = DlvSettings(color_cost=color_cost, window=1, beta=0.7, tau_color=0.05)
    cost = reference.cost_volume(field, np.array([1e6, 2e6]), options)
    np.testing.assert_allclose(cost[:, 5, 8], 0.7 * 2 * 0.05, rtol=1e-4)


def test_phase_shift_moves_a_band_limited_image_exactly():
    grid = make_grid((1, 3), (60, 50), 1, focal=(1, 1))
    field = planes_field(grid, far=0.4, near=0.4, split=1e6, highest=0.2)  # 2.5 px for a step
    centre, right = (reference.channels(field.views[0, k], field.gamma) for k in (1, 2))
    inside = (slice(0, 3), slice(9, -9), slice(9, -9))
    seen = reference.phase_shift(right)(np.array([-2.5, 0]))
    np.testing.assert_allclose(seen[inside], centre[inside], atol=2e-3)
    blurred = reference.bilinear(right)(np.array([-2.5, 0]))
    assert np.abs(blurred - centre)[inside].max() > 0.01


def test_samplers_agree_at_whole_pixels():
    image = np.random.default_rng(0).random((5, 21, 34))
    shift = np.array([2.0, -3.0])
    inside = (slice(None), slice(3, None), slice(None, -2))
    expected = reference.bilinear(image)(shift)[inside]
    np.testing.assert_allclose(expected, image[:, :-3, 2:])
    np.testing.assert_allclose(reference.phase_shift(image)(shift)[inside], expected, atol=1e-5)
