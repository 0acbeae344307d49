from dataclasses import replace

import numpy as np
import pytest
from dlv_fields import make_grid, noise_field

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.pairs import StereoPairs, gradient_share
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.runtime.errors import VolumeError


def with_weights(grid, weights):
    return replace(grid, weights=np.asarray(weights, np.float32))


def test_inner_views_without_the_centre():
    grid = make_grid((9, 9))
    pairs = StereoPairs.from_grid(grid, 7)
    assert len(pairs.indices) == 48
    assert pairs.indices.min() == 1
    assert pairs.indices.max() == 7
    assert [4, 4] not in pairs.indices.tolist()


def test_a_smaller_grid_is_used_whole_and_dark_views_are_left_out():
    grid = with_weights(make_grid(), [[0, 1, 0], [0.3, 1, 1], [0, 0.01, 0]])
    assert StereoPairs.from_grid(grid, 7).indices.tolist() == [[0, 1], [1, 0], [1, 2], [2, 1]]


def test_gamma_is_the_share_of_the_horizontal_offset():
    pairs = StereoPairs.from_grid(make_grid((5, 5)), 5)
    gamma = dict(zip(map(tuple, pairs.indices), pairs.gamma, strict=True))
    assert gamma[2, 4] == 1
    assert gamma[0, 2] == 0
    assert gamma[1, 1] == 0.5
    assert gamma[1, 4] == pytest.approx(2 / 3)


def test_exchanged_axes_have_exchanged_shares():
    shifts = np.array([[0, 0], [1, 2], [-3, 0.5], [0, -1]])  # the first view is straight ahead
    np.testing.assert_allclose(gradient_share(shifts) + gradient_share(shifts[:, ::-1]), 1)


def test_shifts_are_those_of_the_view_grid():
    grid = make_grid((3, 5), jitter=0.1)
    pairs = StereoPairs.from_grid(grid, 5)
    point = np.array([0.02, -0.01, 0.5])
    seen = grid.pinhole.project(point)
    for index, shift in zip(pairs.indices, pairs.shifts(np.array([0.5, 0.7])), strict=True):
        centre_of_light = np.append(grid.positions[tuple(index)] * grid.baseline, 0)
        np.testing.assert_allclose(seen + shift[0], grid.pinhole.project(point - centre_of_light))


def test_a_pair_is_judged_where_all_its_samples_are_inside():
    grid = make_grid((3, 3), (24, 20), jitter=0.1)
    pairs = StereoPairs.from_grid(grid, 3)
    depths = np.array([0.9, 0.5, 0.3])
    shifts = pairs.shifts(depths)
    y, x = np.indices((20, 24))
    for shift, (left, right, top, bottom) in zip(shifts, pairs.inside(depths), strict=True):
        places = np.stack([x, y], axis=-1)[:, :, None] + shift
        inside = ((places >= 0) & (places <= (23, 19))).all(axis=(2, 3))
        expected = np.zeros_like(inside)
        expected[top:bottom, left:right] = True
        np.testing.assert_array_equal(inside, expected)


def test_light_is_the_inverse_variance_of_a_difference():
    rng = np.random.default_rng(0)
    weights = rng.uniform(0.1, 1, (3, 3))
    pairs = StereoPairs.from_grid(with_weights(make_grid(), weights), 3)
    weight = (weights / weights[1, 1])[pairs.indices[:, 0], pairs.indices[:, 1]]
    difference = rng.normal(size=(100_000, 1)) - rng.normal(size=(100_000, 8)) / np.sqrt(weight)
    np.testing.assert_allclose(pairs.light, 2 / difference.var(axis=0), rtol=0.03)


@pytest.mark.parametrize('interpolation', ['neutral', 'bilinear', 'phase'])
@pytest.mark.parametrize(('weights', 'message'), [
    (np.zeros((3, 3)), 'centre view has weight 0.* its picture is not black'),
    (np.diag([0, 1, 0]), 'only the centre has light'),
])
def test_dark_light_fields_are_refused(weights, message, interpolation):
    field = noise_field(with_weights(make_grid(), weights))
    with pytest.raises(VolumeError, match=message):
        build_volume(field, DlvSettings(interpolation=interpolation))


@pytest.mark.parametrize('interpolation', ['neutral', 'bilinear', 'phase'])
def test_a_single_view_is_refused(interpolation):
    field = noise_field(make_grid((1, 1)))
    with pytest.raises(VolumeError, match='of 1x1 views only the centre has light'):
        build_volume(field, DlvSettings(interpolation=interpolation))


@pytest.mark.parametrize('size', [(90, 25), (25, 90)])
def test_depths_that_shift_views_out_of_the_image_are_refused(size):
    with pytest.raises(VolumeError, match=r'at 0\.03 m .* 33 px.*choose a larger near, '
                       'or is the baseline not in metres'):
        build_volume(noise_field(make_grid(size=size)), DlvSettings(near=0.03))


@pytest.mark.parametrize('views', [3, 5])
@pytest.mark.parametrize('baseline', [0.0007, 0.02])
def test_with_the_labels_needed_no_view_moves_by_more_than_a_pixel(views, baseline):
    pairs = StereoPairs.from_grid(make_grid((5, 7), (400, 300), baseline, 0.2), views)
    needed = pairs.labels_needed(0.4, 0.8)
    steps = [np.abs(np.diff(pairs.shifts(depth_labels(0.4, 0.8, count)), axis=1)).max()
             for count in (needed, needed - 1) if count > 1]
    assert steps[0] <= 1
    assert needed == 2 or steps[1] > 1
