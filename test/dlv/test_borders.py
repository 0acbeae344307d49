"""At the image's border fewer views count; what counts there judges all labels alike."""

from dataclasses import replace

import numpy as np
import pytest
from dlv_fields import make_grid, noise_field, planes_field

from pmcl_ros.dlv.cost import cost_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels

CAPTURE = {'near': 0.39, 'far': 0.71}


def dimmed(grid):
    weights = np.random.default_rng(0).uniform(0.05, 1, grid.shape).astype(np.float32)
    weights[grid.centre] = 1
    weights[0, 0] = weights[0, -1] = 0
    return replace(grid, weights=weights)


def spread(costs):
    """(labels, pixels) -> how far the labels' means lie apart, as a part of them."""
    means = costs.mean(axis=1, dtype=float)
    return np.ptp(means) / means.mean()


@pytest.mark.parametrize('weights', ['even', 'uneven'])
@pytest.mark.parametrize('options', [
    {}, {'beta': 0}, {'beta': 1}, {'window': 5}, {'window': 5, 'stride': 2}, {'stride': 4},
    {'crop': (0, 0, 60, 50)}], ids=str)
def test_noise_costs_the_same_at_every_label_at_the_border_too(options, weights):
    grid = make_grid((7, 7), (200, 180), 0.00074, 0.02, focal=(1000, 1000))
    field = noise_field(dimmed(grid) if weights == 'uneven' else grid, sigma=0.05)
    settings = DlvSettings(**{'window': 1} | options)
    costs = cost_volume(field, depth_labels(**CAPTURE, count=21), settings)
    border = np.ones(costs.shape[1:], bool)
    width = 8 // settings.stride
    border[width:-width, width:-width] = False
    assert spread(costs[:, border]) < 0.01
    assert spread(costs[:, ~border]) < 0.01


@pytest.mark.parametrize(('interpolation', 'column', 'dark'), [
    ('bilinear', 0, 3),  # no view to the right of the centre shows what the centre shows
    ('neutral', 3, 4),  # none two steps to the right does; further out smoothing lacks neighbours
])
def test_a_border_pixel_finds_its_depth_as_often_as_an_inner_one_of_as_many_views(
        interpolation, column, dark):
    grid = make_grid((3, 5), (120, 160), 0.0008, focal=(1000, 1000))
    lit = grid.weights.copy()
    lit[:, dark:] = 0
    settings = DlvSettings(interpolation=interpolation, window=1)
    depths = depth_labels(**CAPTURE, count=31)
    found = {'border': [], 'inside': []}
    for seed, depth in enumerate((0.42, 0.46, 0.5, 0.55, 0.6, 0.66)):
        clean = planes_field(grid, depth, depth, 1e6, seed=seed, highest=0.3)
        noise = np.random.default_rng(seed).normal(0, 0.05, clean.views.shape)
        views = np.clip(clean.views ** clean.gamma + noise, 0, 1) ** (1 / clean.gamma)
        all_lit = replace(clean, views=views.astype(np.float32))
        few_lit = replace(all_lit, grid=replace(grid, weights=lit))
        for name, field, columns in (('border', all_lit, slice(column, column + 1)),
                                     ('inside', few_lit, slice(10, -10))):
            best = depths[cost_volume(field, depths, settings)[:, 8:-8, columns].argmin(axis=0)]
            found[name].append(np.abs(1 / best - 1 / depth) < 0.1)
    border, inside = (np.mean([each.mean() for each in found[name]]) for name in found)
    assert 0.2 < inside < 0.95  # not so easy that nothing would show
    assert border > inside - 0.05
