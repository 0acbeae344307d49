import numpy as np
import pytest
from dlv_fields import make_grid, noise_field
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pmcl_ros.dlv.cost import cost_volume
from pmcl_ros.dlv.likelihood import log_likelihood, truncate
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.lightfield.light_field import LightField

COSTS = arrays(np.float32, st.tuples(st.integers(2, 30), st.integers(1, 4), st.integers(1, 40)),
               elements=st.just(0) | st.floats(2 ** -90, 1000, width=32))
# Few values, so that rays have plateaux and ties.
RAYS = arrays(np.float32, st.tuples(st.just(2), st.just(3), st.integers(1, 20)),
              elements=st.sampled_from([0, 0.25, 0.5, 1]))


@settings(max_examples=50, deadline=None)
@given(COSTS)
def test_likelihood_is_the_formula(cost):
    likelihood = log_likelihood(cost)
    exact = cost.astype(float).transpose(1, 2, 0)
    total = exact.sum(axis=2, keepdims=True)
    share = np.divide(exact.max(axis=2, keepdims=True) - exact, total,
                      out=np.zeros_like(exact), where=total > 1e-30)
    np.testing.assert_allclose(likelihood, np.log(share + 1), rtol=2e-6, atol=2e-7)


@settings(max_examples=50, deadline=None)
@given(COSTS)
def test_likelihood_is_zero_at_the_worst_label_and_falls_with_cost(cost):
    likelihood = log_likelihood(cost).transpose(2, 0, 1)
    worst = np.expand_dims(cost.argmax(axis=0), 0)
    assert (np.take_along_axis(likelihood, worst, 0) == 0).all()
    assert (likelihood >= 0).all()
    ordered = np.take_along_axis(likelihood, cost.argsort(axis=0), 0)
    # Costs that differ by less than float32 can tell may come in either order.
    assert (np.diff(ordered, axis=0) <= np.finfo(np.float32).eps).all()


@pytest.mark.parametrize('color_cost', ['l2', 'sad'])
@pytest.mark.parametrize('alike', [True, False])
def test_constant_views_have_no_likelihood(color_cost, alike):
    grid = make_grid((3, 3), (37, 20), 0.006, 0.05)
    views = np.random.default_rng(0).random((3, 3, 1, 1, 3), np.float32)
    views[:] = views[1, 1] if alike else views
    field = LightField(noise_field(grid).header,
                       np.broadcast_to(views, (3, 3, 20, 37, 3)).copy(), grid)
    cost = cost_volume(field, depth_labels(0.3, 0.9, 25), DlvSettings(color_cost=color_cost))
    assert (cost == 0).all() == alike
    assert (log_likelihood(cost) == 0).all()


def truncated(ray, maxima, neighbours):
    """What `truncate` does to one ray, in the obvious way."""
    steps = [(label, value) for label, value in enumerate(ray)
             if label == 0 or value != ray[label - 1]]
    ends = [label for label, _ in steps[1:]] + [len(ray)]
    heights = [-np.inf, *(value for _, value in steps), -np.inf]
    peaks = [((first + end - 1) // 2, value) for k, ((first, value), end) in
             enumerate(zip(steps, ends, strict=True))
             if value > 0 and heights[k] < value > heights[k + 2]]
    kept = np.zeros_like(ray)
    for place, _ in sorted(peaks, key=lambda peak: -peak[1])[:maxima]:
        around = slice(max(place - neighbours, 0), place + neighbours + 1)
        kept[around] = ray[around]
    return kept


@settings(max_examples=150, deadline=None)
@given(RAYS, st.integers(1, 4), st.integers(0, 3))
def test_truncation_is_that_of_each_ray(likelihood, maxima, neighbours):
    expected = np.apply_along_axis(truncated, 2, likelihood, maxima, neighbours)
    np.testing.assert_array_equal(truncate(likelihood, maxima, neighbours), expected)


def test_truncation_by_example():
    ray = np.array([[[3, 1, 1, 5, 2, 1, 4, 4, 4, 0, 2]]], np.float32)
    np.testing.assert_array_equal(truncate(ray, 2, 1)[0, 0], [0, 0, 1, 5, 2, 0, 4, 4, 4, 0, 0])
    np.testing.assert_array_equal(truncate(ray, 3, 0)[0, 0], [3, 0, 0, 5, 0, 0, 0, 4, 0, 0, 0])
