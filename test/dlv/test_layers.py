"""Surfaces read from likelihoods whose maxima are known."""

import numpy as np
import pytest
from dlv_fields import Texture, make_grid
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.signal import find_peaks

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.layers import read_layers
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField

DEPTHS = depth_labels(0.3, 0.9, 40)
INVERSE = 1 / DEPTHS


def place(depth, depths=DEPTHS):
    """Where a depth [m] lies among the labels."""
    return (1 / depth - 1 / depths[0]) / (1 / depths[1] - 1 / depths[0])


def bump(at, height, width=2.5):
    return height * np.exp(-0.5 * ((np.arange(40) - at) / width) ** 2)


@settings(max_examples=50, deadline=None)
@given(st.floats(3, 12), st.floats(26, 36), st.floats(0.2, 1), st.floats(0.2, 1))
@example(5.5, 30.5, 1.0, 0.5)
def test_two_bumps_are_two_surfaces_the_more_likely_first(one, other, height, second):
    assume(abs(height - second) > 0.05)
    ray = (bump(one, height) + bump(other, second)).astype(np.float32)
    layers = read_layers(ray[None, None], DEPTHS, 3)
    order = [0, 1] if height >= second else [1, 0]
    at, tall = np.array([one, other])[order], np.array([height, second])[order]
    np.testing.assert_allclose(place(layers.depths[0, 0, :2]), at, atol=0.06)
    np.testing.assert_allclose(layers.likelihood[0, 0, :2], tall, rtol=0.01)
    # the second derivative of a bump is its height over its width squared
    np.testing.assert_allclose(layers.sharpness[0, 0, :2], tall / 2.5 ** 2, rtol=0.3)
    assert np.isnan(layers.depths[0, 0, 2])
    assert place(layers.front[0, 0]) == pytest.approx(other, abs=0.06)  # labels go far to near
    assert place(layers.behind[0, 0]) == pytest.approx(one, abs=0.06)


@settings(max_examples=100, deadline=None)
@given(arrays(np.float32, (2, 3, 25), elements=st.sampled_from([0, 0.25, 0.5, 0.75, 1])
              | st.floats(0, 1, width=32)), st.sampled_from([0.05, 0.1, 0.3]))
def test_surfaces_are_the_prominent_peaks_that_scipy_finds(likelihood, prominence):
    layers = read_layers(likelihood, depth_labels(0.3, 0.9, 25), 12, prominence)
    for y, x in np.ndindex(2, 3):
        ray = likelihood[y, x].astype(float)
        around = np.concatenate([[-1], ray, [-1]])  # ends are maxima too
        peaks, found = find_peaks(around, plateau_size=1, prominence=0)
        tall = around[peaks]
        # scipy measures the highest against the padding: here against 0
        rise = np.minimum(found['prominences'], tall)
        keep = (tall > 0) & (rise > prominence * ray.max())
        expected = np.sort(tall[keep])[::-1]
        got = layers.likelihood[y, x]
        ends = layers.sharpness[y, x] == 0
        assert np.isfinite(got).sum() >= min(len(np.unique(expected)), 12)
        assert (np.diff(got[np.isfinite(got)]) <= 0.13).all()
        if len(np.unique(tall)) == len(tall):  # which of equals stands out is a convention
            assert np.isfinite(got).sum() == keep.sum()
            np.testing.assert_allclose(got[:keep.sum()][ends[:keep.sum()]],
                                       expected[ends[:keep.sum()]], atol=1e-6)


def test_a_ray_that_tells_nothing_has_no_surface():
    layers = read_layers(np.zeros((4, 5, 40), np.float32), DEPTHS)
    for each in (layers.depths, layers.likelihood, layers.sharpness, layers.front, layers.behind):
        assert np.isnan(each).all()


def test_a_single_surface_has_nothing_behind_it():
    layers = read_layers(bump(12.3, 1).astype(np.float32)[None, None], DEPTHS)
    assert place(layers.front[0, 0]) == pytest.approx(12.3, abs=0.05)
    assert np.isnan(layers.behind[0, 0])


def test_ripples_are_no_surfaces_unless_asked_for():
    ray = bump(20, 1, 6) + 0.02 * np.cos(np.arange(40) * 2)
    few, many = (read_layers(ray.astype(np.float32)[None, None], DEPTHS, 20, prominence)
                 for prominence in (0.1, 0.0))
    assert np.isfinite(few.depths).sum() == 1
    assert np.isfinite(many.depths).sum() > 2


@pytest.mark.parametrize(('ray', 'label'), [
    ([3, 2, 1, 0, 0], 0), ([0, 0, 1, 2, 3], 4), ([0, 2, 2, 2, 0], 2), ([2, 2, 1, 0, 0], 0),
    ([0, 1, 3, 1, 0], 2)])
def test_ends_and_plateaux(ray, label):
    depths = depth_labels(0.3, 0.9, 5)
    layers = read_layers(np.array(ray, np.float32)[None, None], depths)
    assert place(layers.depths[0, 0, 0], depths) == pytest.approx(label, abs=1e-4)
    assert layers.likelihood[0, 0, 0] == max(ray)


def test_a_ripple_between_equal_maxima_makes_no_two_surfaces():
    ray = np.array([0, 1, 0.95, 1, 0], np.float32)
    layers = read_layers(ray[None, None], depth_labels(0.3, 0.9, 5))
    assert np.isfinite(layers.depths).sum() == 1


def lambertian_field(size, disparity, slope):
    """A slanted textured plane in 7x7 views: `disparity` px per view step, growing by `slope`.

    slope: (2,) px per view step and px along x and y; a view's pixel u shows the centre view's x
    with u = x - a (disparity + slope x): solved for x.
    """
    grid = make_grid((7, 7), (size, size), 1, focal=(1, 1))
    y, x = np.indices((size, size)).astype(float)
    texture, middle = Texture(5, highest=0.25), (size - 1) / 2
    views = np.empty((7, 7, size, size, 3), np.float32)
    noise = np.random.default_rng(5)
    for place in np.ndindex(7, 7):
        a, b = grid.positions[place]
        # (x, y) - (a, b) (d + slope (x, y)) = (u, v): a rank-one change of the identity
        right = np.stack([x - middle + a * disparity, y - middle + b * disparity], axis=-1)
        inverse = np.linalg.inv(np.eye(2) - np.outer([a, b], slope))
        seen = right @ inverse.T + middle
        encoded = texture(seen[..., 0], seen[..., 1]) + noise.normal(0, 0.01, (size, size, 3))
        views[place] = np.clip(encoded, 0, 1) ** 2.4
    truth = disparity + slope[0] * (x - middle) + slope[1] * (y - middle)
    return LightField(Header(), views, grid), truth


@pytest.mark.parametrize('slope', [(0, 0), (0.008, 0), (-0.004, 0.006)])
def test_bad_pixels_of_a_lambertian_scene(slope):
    """The measure of the 4D Light Field Benchmark: off by more than 0.07 px per view step."""
    field, truth = lambertian_field(110, 1.5, np.array(slope))
    volume = build_volume(field, DlvSettings(near=0.4, far=1, edge_labels=2))  # 1 to 2.5 px
    away = np.s_[14:-14, 14:-14]
    bad = ~(np.abs(1 / volume.depth_map() - truth) < 0.07)
    assert bad[away].mean() < 0.15
    labels = 1 / volume.depths[volume.likelihood.argmax(axis=2)]
    fine, coarse = (np.sqrt(np.mean((each - truth)[away][~bad[away]] ** 2))
                    for each in (1 / volume.depth_map(), labels))
    assert fine < coarse  # between labels is better than at them
