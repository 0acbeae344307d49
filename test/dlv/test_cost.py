"""The fast cost volume against the plain one, and the plain one against what it should be."""

from dataclasses import replace

import numpy as np
import pytest
from dlv_fields import make_grid, noise_field, planes_field
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.dlv import reference
from pmcl_ros.dlv.cost import CostInputs, cost_volume
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.planes import ENCODING
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.lightfield.light_field import LightField

FAST = ['neutral', 'bilinear']


def assert_same(field, options, depths):
    fast = cost_volume(field, depths, options)
    plain = reference.cost_volume(field, depths, options)
    assert fast.dtype == np.float32
    samples = len(StereoPairs.from_grid(field.grid, options.views).indices) * options.window ** 2
    np.testing.assert_allclose(fast, plain, rtol=1e-5, atol=2e-6 * samples)
    return agreement(fast, plain), agreement(-fast, -plain)


def agreement(fast, plain):
    """The part of the pixels whose highest label is the same, or as high but for rounding."""
    chosen = np.take_along_axis(plain, fast.argmax(0)[None], 0)[0]
    same = fast.argmax(0) == plain.argmax(0)
    return (same | (chosen >= plain.max(0) - 1e-6 * np.abs(plain).max(0))).mean()


@pytest.mark.parametrize('interpolation', FAST)
@pytest.mark.parametrize('window', [1, 5])
@pytest.mark.parametrize('color_cost', ['l2', 'sad'])
@pytest.mark.parametrize(('views', 'size', 'baseline', 'jitter'), [
    ((3, 3), (24, 20), 0.001, 0),  # within one cell
    ((7, 7), (33, 29), 0.006, 0),  # the proportions of a capture: 0.7 to 2 px for each step
    ((5, 7), (31, 17), 0.006, 0.05),  # as measured positions are
    ((1, 5), (40, 9), 0.03, 0.3),  # up to 20 px, rows not in line
])
def test_fast_cost_is_the_reference(views, size, baseline, jitter, color_cost, window,
                                    interpolation):
    field = noise_field(make_grid(views, size, baseline, jitter))
    options = DlvSettings(color_cost=color_cost, window=window, interpolation=interpolation)
    worst, best = assert_same(field, options, depth_labels(0.3, 0.9, 12))
    assert worst > 0.999
    assert best > 0.999


@settings(max_examples=25, deadline=None)
@given(width=st.integers(1, 50), height=st.integers(1, 40), rows=st.sampled_from([1, 3]),
       columns=st.sampled_from([3, 5]), window=st.sampled_from([1, 3, 7]),
       beta=st.floats(0, 1), tau=st.floats(0.01, 2), labels=st.integers(2, 40),
       step=st.floats(0.01, 0.99), jitter=st.floats(0, 0.3), seed=st.integers(0, 99),
       crop=st.tuples(*[st.floats(0, 0.9)] * 4), stride=st.sampled_from([1, 2, 4]),
       view_weights=st.sampled_from(['light', 'equal']), interpolation=st.sampled_from(FAST))
def test_fast_cost_is_the_reference_whatever_the_shape(
        width, height, rows, columns, window, beta, tau, labels, step, jitter, seed, crop, stride,
        view_weights, interpolation):
    # `step`: the largest displacement as a part of what the image allows.
    grid = make_grid((rows, columns), (width, height), 1, jitter, focal=(1, 1), seed=seed)
    reach = np.abs(grid.positions).max(axis=(0, 1))
    near = (reach / (width, height)).max() / step
    weights = np.random.default_rng(seed).uniform(0.1, 1, grid.shape).astype(np.float32)
    field = noise_field(replace(grid, weights=weights), seed)
    left, top = int(crop[0] * width), int(crop[1] * height)
    options = DlvSettings(
        window=window, beta=beta, tau_color=tau, tau_gradient=tau, stride=stride,
        view_weights=view_weights, interpolation=interpolation,
        crop=(left, top, int(crop[2] * (width - left)), int(crop[3] * (height - top))))
    assert_same(field, options, depth_labels(near, 4 * near, labels))


@pytest.mark.parametrize('interpolation', FAST)
def test_rows_longer_than_a_tile(interpolation):
    field = noise_field(make_grid((3, 3), (701, 5), 0.006))
    options = DlvSettings(interpolation=interpolation)
    worst, best = assert_same(field, options, depth_labels(0.3, 0.9, 7))
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


@pytest.mark.parametrize('interpolation', FAST)
def test_a_crop_is_a_part_and_a_stride_takes_every_nth(interpolation):
    field = noise_field(make_grid((3, 3), (41, 33), 0.006))
    depths = depth_labels(0.3, 0.9, 9)
    options = DlvSettings(interpolation=interpolation, window=5)
    whole = cost_volume(field, depths, options)
    part = cost_volume(field, depths, options.model_copy(update={'crop': (7, 5, 20, 13)}))
    np.testing.assert_allclose(part, whole[:, 5:18, 7:27], rtol=1e-4)
    rest = cost_volume(field, depths, options.model_copy(update={'crop': (30, 0, 0, 4)}))
    np.testing.assert_allclose(rest, whole[:, :4, 30:], rtol=1e-4)
    single = options.model_copy(update={'window': 1})
    pixels = cost_volume(field, depths, single)
    for stride in (2, 4):
        few = single.model_copy(update={'stride': stride, 'crop': (1, 2, 0, 0)})
        np.testing.assert_allclose(cost_volume(field, depths, few),
                                   pixels[:, 2::stride, 1::stride], rtol=1e-4)


@pytest.mark.parametrize('color_cost', ['l2', 'sad'])
def test_a_pair_counts_by_the_light_it_got(color_cost):
    # All but one pair alike: what the dim one adds is its share by light.
    grid = make_grid((1, 3), (16, 12), 0.01, focal=(1, 1))
    views = np.full((1, 3, 12, 16, 3), 0.5, np.float32)
    views[0, 2] = 0.6
    depths, cost = np.array([2e6, 1e6]), {}
    for weight in (1, 0.25):
        dim = replace(grid, weights=np.array([[1, 1, weight]], np.float32))
        field = LightField(noise_field(grid).header, views ** (1 / ENCODING), dim)
        for view_weights in ('light', 'equal'):
            options = DlvSettings(color_cost=color_cost, view_weights=view_weights)
            cost[weight, view_weights] = cost_volume(field, depths, options)[0, 6, 8]
    assert cost[1, 'light'] == cost[1, 'equal'] == cost[0.25, 'equal']
    assert cost[0.25, 'light'] == pytest.approx(cost[1, 'light'] * 2 * 0.25 / 1.25)


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
    field = LightField(noise_field(grid).header, views ** (1 / ENCODING), grid)
    options = DlvSettings(color_cost=color_cost, window=3, beta=0.7)
    cost = reference.cost_volume(field, np.array([1e6, 2e6]), options)
    np.testing.assert_allclose(cost[:, 5, 8], 0.7 * 2 * 9 * colour, rtol=1e-4)
    options = DlvSettings(color_cost=color_cost, window=1, beta=0.7, tau_color=0.05)
    cost = reference.cost_volume(field, np.array([1e6, 2e6]), options)
    np.testing.assert_allclose(cost[:, 5, 8], 0.7 * 2 * 0.05, rtol=1e-4)


def test_phase_shift_moves_a_band_limited_image_exactly():
    grid = make_grid((1, 3), (60, 50), 1, focal=(1, 1))
    field = planes_field(grid, far=0.4, near=0.4, split=1e6, highest=0.2)  # 2.5 px for a step
    centre, right = (reference.channels(field.views[0, k]) for k in (1, 2))
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


@pytest.mark.parametrize('cycles', [0.03, 0.1, 0.2, 0.35])
@pytest.mark.parametrize('fraction', [0.25, 0.5])
def test_bilinear_samples_of_a_wave_differ_from_shifted_ones_by_what_theory_says(cycles, fraction):
    x = np.broadcast_to(np.arange(240.0), (1, 8, 240))
    wave = np.cos(2 * np.pi * cycles * x + 0.3)
    shift = np.array([fraction, 0])
    shifted, bilinear = (sampler(wave)(shift)[..., 60:-60]
                         for sampler in (reference.phase_shift, reference.bilinear))
    turn = 2j * np.pi * cycles
    exact = np.cos(2 * np.pi * cycles * (x + fraction) + 0.3)[..., 60:-60]
    response = (1 - fraction + fraction * np.exp(turn)) / np.exp(turn * fraction)
    np.testing.assert_allclose(shifted, exact, atol=5e-3)
    known = np.real(response * np.exp(turn * (x + fraction) + 0.3j))[..., 60:-60]
    np.testing.assert_allclose(bilinear, known, atol=1e-9)


def test_phase_shift_and_bilinear_cost_the_same_where_views_move_by_whole_pixels():
    # In between, bilinear weights average what they read: noise costs less.
    grid = make_grid((3, 3), (60, 50), 1, focal=(1, 1))
    depths = depth_labels(1 / 3, 1, 5)  # 1, 1.5, 2, 2.5, 3 px for each view step
    phase, bilinear = (
        reference.cost_volume(noise_field(grid, sigma=0.05), depths,
                              DlvSettings(interpolation=each, window=1))[:, 4:-4, 4:-4]
        for each in ('phase', 'bilinear'))
    np.testing.assert_allclose(phase[::2], bilinear[::2], rtol=1e-4)
    assert (bilinear[1::2].mean(axis=(1, 2)) < 0.9 * phase[1::2].mean(axis=(1, 2))).all()


def test_a_periodic_band_limited_view_is_shifted_exactly_by_the_shift_theorem():
    """And by `phase_shift` as exactly, away from the borders, which it cannot know go on."""
    texture = np.random.default_rng(0).normal(size=(1, 128, 128))
    spectrum = np.fft.fft2(texture)
    along, across = np.fft.fftfreq(128)[:, None], np.fft.fftfreq(128)
    spectrum[:, np.hypot(along, across) > 0.25] = 0
    shift = np.array([-1.3, 0.6])
    theorem = np.real(np.fft.ifft2(spectrum * np.exp(2j * np.pi * (shift[0] * across
                                                                   + shift[1] * along))))
    image = np.real(np.fft.ifft2(spectrum))
    off = np.abs(reference.phase_shift(image)(shift) - theorem)[:, 24:-24, 24:-24] / image.std()
    assert off.max() < 0.02
    blurred = np.abs(reference.bilinear(image)(shift) - theorem)[:, 24:-24, 24:-24] / image.std()
    assert blurred.max() > 10 * off.max()


def test_crops_pay_for_what_they_need():
    field = noise_field(make_grid((3, 3), (200, 180), 0.006))
    depths, crop = depth_labels(0.3, 0.9, 9), DlvSettings(crop=(90, 70, 20, 30), window=3)
    whole = CostInputs.from_light_field(field, depths, DlvSettings(window=3)).planes
    part = CostInputs.from_light_field(field, depths, crop).planes
    assert part.size < whole.size / 10
