"""Polynomials through the views, against polynomials that are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.dlv.view_moments import REST, SECOND, TAPS, ViewMoments, refocused_moments
from pmcl_ros.lightfield.light_field import nominal_positions
from pmcl_ros.runtime.errors import VolumeError


def places(side, jitter=0.0, seed=0):
    noise = np.random.default_rng(seed).normal(0, 1, (side ** 2, 2)) * jitter
    return nominal_positions(side, side).reshape(-1, 2) + noise


@settings(max_examples=30, deadline=None)
@given(st.sampled_from([3, 5, 7]), st.floats(0, 0.1), st.integers(0, 99),
       st.lists(st.floats(-2, 2), min_size=6, max_size=6))
def test_a_polynomial_is_found_and_nothing_is_left_of_it(side, jitter, seed, coefficients):
    where = places(side, jitter, seed)
    light = np.random.default_rng(seed).uniform(0.2, 1, len(where))
    moments = ViewMoments.from_places(where, light)
    a, b = where.T
    values = np.stack([np.ones_like(a), a, b, a * a, a * b, b * b], axis=1) @ coefficients
    np.testing.assert_allclose(moments.weights[:6] @ values, coefficients, atol=1e-9)
    np.testing.assert_allclose(moments.weights[REST] @ values, 0, atol=1e-8)
    # Noise of variance 1 / light comes out as said.
    covariance = moments.weights / light @ moments.weights.T
    np.testing.assert_allclose(covariance[:6, :6], moments.covariance, atol=1e-9)
    np.testing.assert_allclose(covariance[REST, REST], np.eye(2), atol=1e-9)


@pytest.mark.parametrize('angle', [0, 0.6, 2.0])
def test_a_surface_beside_the_refocused_depth(angle):
    """A wave's second-degree part is that of its second and fourth derivatives, to sixth order."""
    moments = ViewMoments.from_places(places(7), np.ones(49))
    wave = np.array([np.cos(angle), np.sin(angle)])

    def missed(beside):
        seen = moments.weights[SECOND] @ np.cos(moments.places @ wave * beside)
        x, y = wave * beside
        second = -np.array([x * x / 2, x * y, y * y / 2])
        fourth = np.array([x ** 4, x ** 3 * y, x * x * y * y, x * y ** 3, y ** 4])
        return np.abs(seen - second - moments.fourth() @ fourth).max()

    assert missed(0.2) < 1e-3
    assert missed(0.1) == pytest.approx(missed(0.2) / 64, rel=0.1)


def test_refocused_pictures_are_read_between_pixels():
    """Polynomials of the fifth degree are read exactly."""
    pad, (height, width) = 9, (6, 11)
    y, x = np.indices((height + 2 * pad, width + 2 * pad)).astype(float)

    def picture(x, y):
        u, v = (x - 14) / 10, (y - 12) / 10
        return 1 + u - 2 * v + u * v + u ** 5 - v ** 4

    planes = np.stack([np.stack([picture(x, y)] * 3)] * 2).astype(np.float32)
    shifts = np.array([[1.3, -2.6], [-0.4, 0.0]])
    weights = np.array([[1.0, 0], [0, 1], [2, -1]])
    found = refocused_moments(planes, pad, shifts, weights, range(-1, 5), range(2, 9))
    rows, columns = np.mgrid[-1:5, 2:9] + pad
    one, other = (picture(columns + dx, rows + dy) for dx, dy in shifts)
    for moment, expected in zip(found, (one, other, 2 * one - other), strict=True):
        np.testing.assert_allclose(moment, np.stack([expected] * 3), atol=2e-5)
    assert pad >= TAPS


@pytest.mark.parametrize('where', [places(7)[:7], places(3)[:5]])
def test_too_few_views_are_refused(where):
    with pytest.raises(VolumeError, match=f'{len(where)} views cannot tell two layers'):
        ViewMoments.from_places(where, np.ones(len(where)))
