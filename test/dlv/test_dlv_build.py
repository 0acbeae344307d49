"""The whole arrow, on scenes whose depth is known."""

import numpy as np
import pytest
from dlv_fields import make_grid, noise_field, planes_field

from pmcl_ros.dlv import reference
from pmcl_ros.dlv.build import build_volume, warm_up
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels

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


@pytest.mark.parametrize('interpolation', ['bilinear', 'phase'])
@pytest.mark.parametrize('color_cost', ['l2', 'sad'])
def test_depth_of_two_planes(planes, interpolation, color_cost):
    options = DlvSettings(labels=25, interpolation=interpolation, color_cost=color_cost, views=5)
    volume = build_volume(planes, options)
    assert (labels_off(volume, FAR, slice(8, SPLIT - 8)) <= 1).mean() > 0.95
    assert (labels_off(volume, NEAR, slice(SPLIT + 8, -8)) <= 1).mean() > 0.95


def test_phase_and_bilinear_find_the_same_label_on_smooth_texture(planes):
    best = [build_volume(planes, DlvSettings(labels=15, views=5, interpolation=interpolation))
            .likelihood[8:-8, 8:-8].argmax(axis=2) for interpolation in ('bilinear', 'phase')]
    assert (best[0] == best[1]).mean() > 0.95


def test_volume_carries_capture_labels_and_edges(planes):
    options = DlvSettings(labels=9, edge_labels=5, views=3)
    volume = build_volume(planes, options)
    assert volume.header is planes.header
    assert volume.likelihood.shape == (60, 120, 9)
    assert volume.likelihood.dtype == np.float32
    np.testing.assert_allclose(volume.depths[[0, -1]], [0.9, 0.3])
    assert volume.edges.tensor.shape == (60, 120, 5, 3)
    assert volume.edges.header is planes.header


def test_truncated_volume_keeps_the_best_label(planes):
    options = DlvSettings(labels=25, views=3, maxima=1, neighbours=1)
    whole = build_volume(planes, options).likelihood
    kept = build_volume(planes, options.model_copy(update={'truncate': True})).likelihood
    assert (np.count_nonzero(kept, axis=2) <= 3).all()
    np.testing.assert_array_equal(kept.argmax(axis=2), whole.argmax(axis=2))
    assert ((kept == 0) | (kept == whole)).all()


def test_noise_costs_the_same_at_every_label_only_with_phase_shift():
    """What bilinear sampling does to flat pixels, and why the paper shifts phases."""
    grid = make_grid((3, 3), (96, 96), 1, focal=(1, 1))
    field = noise_field(grid, sigma=0.05)
    depths = depth_labels(0.5, 1, 9)  # 1 to 2 px for each step, half a pixel at the middle label
    means = {}
    for interpolation in ('bilinear', 'phase'):
        options = DlvSettings(interpolation=interpolation, window=1)
        cost = reference.cost_volume(field, depths, options)
        means[interpolation] = cost[:, 4:-4, 4:-4].mean(axis=(1, 2))
    assert np.ptp(means['phase']) < 0.01 * means['phase'].mean()
    assert means['bilinear'][4] < 0.9 * means['bilinear'][[0, 8]].min()


def test_warm_up_needs_no_light_field():
    warm_up()
