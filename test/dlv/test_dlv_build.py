"""The whole arrow, on scenes whose depth is known."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from dlv_fields import make_grid, noise_field, planes_field

from pmcl_ros.dlv import cost, reference
from pmcl_ros.dlv.build import build_volume, warm_up
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import checked_labels, depth_labels
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import VolumeError

FAR, NEAR, SPLIT = 0.75, 0.4, 60


@pytest.fixture(scope='module')
def planes():
    """Two planes as a capture would show them: 0.8 and 1.5 px for each view step."""
    grid = make_grid((5, 5), (120, 60), 0.0006, 0.02, focal=(1000, 1000))
    return planes_field(grid, FAR, NEAR, SPLIT)


def labels_off(volume, depth, columns):
    """How many labels the best one is from `depth`, of the pixels between `columns`."""
    inverse = 1 / volume.depths
    expected = (1 / depth - inverse[0]) / (inverse[1] - inverse[0])
    return np.abs(volume.likelihood[8:-8, columns].argmax(axis=2) - expected)


@pytest.mark.parametrize('interpolation', ['neutral', 'bilinear', 'phase'])
@pytest.mark.parametrize('color_cost', ['l2', 'sad'])
def test_depth_of_two_planes(planes, interpolation, color_cost):
    options = DlvSettings(labels=25, interpolation=interpolation, color_cost=color_cost, views=5)
    volume = build_volume(planes, options)
    assert (labels_off(volume, FAR, slice(8, SPLIT - 8)) <= 1).mean() > 0.95
    assert (labels_off(volume, NEAR, slice(SPLIT + 8, -8)) <= 1).mean() > 0.95


def test_all_interpolations_find_the_same_label_on_smooth_texture(planes):
    neutral, bilinear, phase = (
        build_volume(planes, DlvSettings(labels=15, views=5, interpolation=interpolation))
        .likelihood[8:-8, 8:-8].argmax(axis=2) for interpolation in ('neutral', 'bilinear',
                                                                     'phase'))
    assert (bilinear == phase).mean() > 0.95
    assert (neutral == phase).mean() > 0.95


def test_volume_carries_capture_and_labels(planes):
    options = DlvSettings(labels=9, views=3)
    volume = build_volume(planes, options)
    assert volume.header is planes.header
    assert volume.likelihood.shape == (60, 120, 9)
    assert volume.likelihood.dtype == np.float32
    np.testing.assert_allclose(volume.depths[[0, -1]], [0.9, 0.3])


def test_truncated_volume_keeps_the_best_label(planes):
    options = DlvSettings(labels=25, views=3, maxima=1, neighbours=1)
    whole = build_volume(planes, options).likelihood
    kept = build_volume(planes, options.model_copy(update={'truncate': True})).likelihood
    assert (np.count_nonzero(kept, axis=2) <= 3).all()
    np.testing.assert_array_equal(kept.argmax(axis=2), whole.argmax(axis=2))
    assert ((kept == 0) | (kept == whole)).all()


def costs_of_noise(grid, near, far, labels=21, **options):
    """Mean cost at each label, of a grey picture that shows nothing but white noise."""
    field = noise_field(grid, sigma=0.05)
    options = DlvSettings(window=1, **options)
    volume = cost.cost_volume(field, depth_labels(near, far, labels), options)
    inside = volume[:, 6:-6, 6:-6]
    assert (inside > 0).all()
    return inside.mean(axis=(1, 2), dtype=float)


@pytest.mark.parametrize(('views', 'baseline', 'near', 'far'), [
    ((7, 7), 0.00074, 0.39, 0.71),  # a capture
    ((3, 3), 0.001, 0.5, 1),  # 1 to 2 px for each step, half a pixel in the middle
    ((5, 5), 0.0002, 0.3, 0.9),  # all within a pixel
    ((1, 5), 0.0008, 0.3, 0.9),  # along x alone
])
@pytest.mark.parametrize('options', [
    {}, {'color_cost': 'sad'}, {'beta': 1}, {'beta': 0}, {'tau_color': 0.08, 'tau_gradient': 0.04},
    {'view_weights': 'equal', 'stride': 2}], ids=str)
def test_noise_costs_the_same_at_every_label(views, baseline, near, far, options):
    grid = make_grid(views, (200, 180), baseline, 0.02, focal=(1000, 1000))
    means = costs_of_noise(grid, near, far, **options)
    assert np.ptp(means) < 0.01 * means.mean()


def test_noise_costs_less_half_way_between_pixels_if_sampled_bilinearly():
    """Why that is not the default."""
    grid = make_grid((3, 3), (160, 150), 0.001, focal=(1000, 1000))
    means = costs_of_noise(grid, 0.5, 1, interpolation='bilinear')
    assert means[10] < 0.9 * means[[0, 20]].min()


def test_phase_shift_leaves_noise_as_it_is():
    grid = make_grid((3, 3), (96, 96), 1, focal=(1, 1))
    options = DlvSettings(interpolation='phase', window=1)
    costs = reference.cost_volume(noise_field(grid, sigma=0.05), depth_labels(0.5, 1, 5), options)
    means = costs[:, 4:-4, 4:-4].mean(axis=(1, 2))
    assert np.ptp(means) < 0.01 * means.mean()


def noisy_plane(grid, depth, highest, contrast=1.0, sigma=0.05, seed=0):
    """A textured plane; the noise of each view is that of the light it got."""
    clean = planes_field(grid, depth, depth, 1e6, seed=seed, highest=highest)
    noise = np.random.default_rng(seed).normal(0, sigma, clean.views.shape)
    noise /= np.sqrt(grid.weights)[:, :, None, None, None]
    encoded = 0.5 + contrast * (clean.views ** clean.gamma - 0.5) + noise
    views = np.clip(encoded, 0, 1) ** (1 / clean.gamma)
    return replace(clean, views=views.astype(np.float32))


def label_errors(field, depth, **options):
    """(pixels) distance of the best label from that of `depth`, at most 15, away from borders."""
    volume = cost.cost_volume(field, depth_labels(0.4, 0.75, 75), DlvSettings(**options))
    inverse = 1 / depth_labels(0.4, 0.75, 75)
    best = volume[:, 10:-10, 10:-10].argmin(axis=0)
    off = np.abs(best - (1 / depth - inverse[0]) / (inverse[1] - inverse[0]))
    return np.minimum(off, 15).ravel()


@pytest.mark.parametrize('highest', [0.12, 0.25, 0.35])
@pytest.mark.parametrize('contrast', [0, 0.2, 1])
def test_neutral_sampling_is_more_accurate_than_bilinear_with_noise_and_without(
        highest, contrast):
    # contrast 0 stands for no noise at full contrast
    grid = make_grid((5, 5), (100, 70), 0.0006, 0.02, focal=(1000, 1000))
    found = {'neutral': [], 'bilinear': []}
    for depth in (0.45, 0.5, 0.533, 0.6, 0.667):
        field = noisy_plane(grid, depth, highest, contrast or 1, 0.02 if contrast else 0,
                            int(1000 * depth))
        for interpolation, errors in found.items():
            errors.append(label_errors(field, depth, interpolation=interpolation))
    rms = {name: np.sqrt(np.mean(np.square(errors))) for name, errors in found.items()}
    assert rms['neutral'] < (1.02 if contrast == 0 else 0.8) * rms['bilinear']


def test_dim_views_are_worth_less():
    # All views but the inner 3x3 got a tenth of the light.
    grid = make_grid((5, 5), (100, 70), 0.0006, focal=(1000, 1000))
    weights = np.full((5, 5), 0.05, np.float32)
    weights[1:4, 1:4] = 1
    grid = replace(grid, weights=weights)
    rms = {name: np.sqrt(np.mean([label_errors(noisy_plane(grid, depth, 0.2, sigma=0.04), depth,
                                               view_weights=name) ** 2
                                  for depth in (0.45, 0.533, 0.6)]))
           for name in ('light', 'equal')}
    assert rms['light'] < 0.9 * rms['equal']


@pytest.mark.parametrize('interpolation', ['neutral', 'bilinear', 'phase'])
def test_labels_whose_samples_leave_the_image_are_not_punished(interpolation):
    # A near plane: along the border half of the views do not show what the centre view shows.
    grid = make_grid((5, 5), (60, 50), 0.0008, focal=(1000, 1000))  # up to 5 px
    field = planes_field(grid, 0.34, 0.34, 1e6)
    options = DlvSettings(interpolation=interpolation, labels=15, window=3, edge_labels=2)
    volume = build_volume(field, options)
    inverse = 1 / volume.depths
    expected = (1 / 0.34 - inverse[0]) / (inverse[1] - inverse[0])
    off = np.abs(volume.likelihood.argmax(axis=2) - expected)
    border = np.ones(off.shape, bool)
    border[6:-6, 6:-6] = False
    assert (off[border] <= 1).mean() > 0.9


def test_crop_and_stride_carry_their_camera(planes):
    whole = build_volume(planes, DlvSettings(labels=9, edge_labels=5, views=3, window=1))
    part = build_volume(planes, DlvSettings(labels=9, edge_labels=5, views=3, window=1, stride=2,
                                            crop=(20, 10, 61, 40)))
    assert part.pinhole == planes.grid.pinhole.crop(20, 10, 61, 40).subsample(2)
    np.testing.assert_allclose(part.likelihood, whole.likelihood[10:50:2, 20:81:2], atol=1e-5)


def test_warm_up_needs_no_light_field():
    warm_up()


def test_too_few_labels_for_a_wide_baseline_are_told_once(caplog):
    field = noise_field(make_grid((3, 3), (90, 80), 0.05, focal=(400, 400)))
    few = DlvSettings(near=0.4, far=0.6, labels=9, edge_labels=18, views=3)
    with caplog.at_level(logging.WARNING):
        build_volume(field, few)
        build_volume(field, few)
    needed = 18  # 50 mm * 400 px * (1 / 0.4 m - 1 / 0.6 m) = 16.7 px
    assert [each.getMessage() for each in caplog.records] == [
        'views move by up to 2.1 px from label to label, more than one: set labels to '
        f'{needed} (it is 9), or near and far closer together']


def test_no_number_of_labels_is_advised_that_cannot_be_set(caplog):
    grid = make_grid((1, 3), (5000, 100), 0.05, focal=(40_000, 40_000))
    checked_labels(StereoPairs.from_grid(grid, 3), DlvSettings(near=0.5, far=0.8, labels=9),
                   grid.pinhole, 'labels')
    assert 'up to 187.5 px from label to label, more than one: make pixels larger' in caplog.text


@pytest.mark.parametrize(('interpolation', 'size'), [('neutral', r'13\.4'), ('phase', r'36\.9')])
def test_a_volume_that_fits_no_memory_is_refused(interpolation, size):
    grid = make_grid((1, 2), (2000, 2000), 0.0001)
    field = LightField(Header(), np.zeros((1, 2, 2000, 2000, 3), np.float32), grid)
    with pytest.raises(VolumeError, match=f'300 labels of 2000x2000 px need {size} GiB, more'):
        build_volume(field, DlvSettings(labels=300, interpolation=interpolation))


def test_a_part_of_an_image_fits_where_all_of_it_does_not():
    grid = make_grid((1, 2), (2000, 2000), 0.0001)
    field = LightField(Header(), np.zeros((1, 2, 2000, 2000, 3), np.float32), grid)
    part = build_volume(field, DlvSettings(labels=300, edge_labels=2, crop=(900, 800, 40, 30)))
    assert part.likelihood.shape == (30, 40, 300)
