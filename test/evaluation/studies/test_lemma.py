"""Rays as mixtures, and the paper's Lemma 1: where it holds, and that it does not elsewhere."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import norm

from pmcl_ros.evaluation.studies.lemma import (
    BACK,
    FRONT,
    NEITHER,
    Mixture,
    TwoLayers,
    counterexample,
    depth_likelihood,
    printed,
    squared_distance,
)

COLOURS = arrays(float, (2, 3), elements=st.floats(0, 1))
SIGMAS = arrays(float, 3, elements=st.floats(0.02, 0.3))
ALPHAS = st.floats(0, 1)


def mixture(alpha, means, sigma):
    return Mixture(np.array([alpha, 1 - alpha]), means, sigma)


@settings(max_examples=25, deadline=None)
@given(ALPHAS, ALPHAS, COLOURS, COLOURS, SIGMAS)
def test_distance_is_the_integral(alpha, beta, means, others, sigma):
    one, other = mixture(alpha, means, sigma), mixture(beta, others, sigma)

    def density(ray, x, channel):
        return norm.pdf(x, ray.means[:, channel], sigma[channel]) @ ray.shares

    x = np.arange(-3, 4, 0.002)[:, None]
    whole = sum(((density(one, x, c) - density(other, x, c)) ** 2).sum() for c in range(3)) * 0.002
    assert squared_distance(one, other) == pytest.approx(whole, rel=1e-6, abs=1e-9)


@settings(deadline=None)
@given(ALPHAS, ALPHAS, COLOURS, COLOURS, SIGMAS)
def test_distance_is_a_squared_metric(alpha, beta, means, others, sigma):
    one, other = mixture(alpha, means, sigma), mixture(beta, others, sigma)
    distance = squared_distance(one, other)
    assert distance >= -1e-12
    assert distance == pytest.approx(squared_distance(other, one), rel=1e-9, abs=1e-12)
    assert squared_distance(one, one) == pytest.approx(0, abs=1e-12)
    third = mixture(0.5, (means + others) / 2, sigma)
    legs = np.sqrt(np.maximum([squared_distance(one, third), squared_distance(third, other)], 0))
    assert np.sqrt(max(distance, 0)) <= legs.sum() + 1e-6


def test_distance_of_nearly_equal_rays_keeps_its_digits():
    # Of two single surfaces: 2 A (1 - exp(-d^2 / 4 s^2)), which tends to A d^2 / (2 s^2).
    means, step, sigma = np.full((1, 1), 0.5), 1e-7, np.array([0.1])
    one, other = (Mixture(np.ones(1), each, sigma) for each in (means, means + step))
    expected = step ** 2 / (2 * sigma[0] ** 2) / np.sqrt(4 * np.pi * sigma[0] ** 2)
    assert squared_distance(one, other) == pytest.approx(expected, rel=1e-6)


@st.composite
def lemma_scenes(draw):
    """Scenes as the lemma assumes: equal steps on both surfaces, which are many sigma apart."""
    sigma = draw(SIGMAS)
    step = sigma * draw(arrays(float, 3, elements=st.floats(0.1, 3)))
    signs = draw(arrays(int, (2, 3), elements=st.sampled_from([-1, 1])))
    ray = draw(arrays(float, 3, elements=st.floats(0, 1)))
    gap = sigma * draw(arrays(float, 3, elements=st.floats(30, 60)))
    front = np.stack([ray, ray + signs[0] * step])
    back = np.stack([ray + gap, ray + gap + signs[1] * step])
    return TwoLayers(np.array(draw(ALPHAS)), front, back, sigma)


@settings(max_examples=200, deadline=None)
@given(lemma_scenes())
def test_lemma_values_ratio_and_order(scene):
    likelihood = scene.likelihood()
    alpha = float(scene.alpha)
    np.testing.assert_allclose(likelihood, printed(alpha) / 2, atol=1e-6)
    # the ratio (1 - alpha)^2 : alpha^2 : 0
    np.testing.assert_allclose(likelihood[BACK] * alpha ** 2,
                               likelihood[FRONT] * (1 - alpha) ** 2, atol=1e-6)
    assert likelihood[NEITHER] == pytest.approx(0, abs=1e-9)
    assume(abs(alpha - 0.5) > 1e-3)
    assert (alpha < 1 - alpha) == (likelihood[FRONT] < likelihood[BACK])


@settings(max_examples=100, deadline=None)
@given(lemma_scenes(), st.integers(1, 20))
def test_lemma_holds_for_the_sum_over_pairs(scene, pairs):
    distances = np.repeat(scene.distances()[None], pairs, axis=0)
    np.testing.assert_allclose(depth_likelihood(distances), pairs * scene.likelihood())


@settings(max_examples=100, deadline=None)
@given(ALPHAS, COLOURS, COLOURS, SIGMAS)
def test_whatever_the_scene_the_change_of_a_surface_is_what_counts(alpha, front, back, sigma):
    # Without the terms between the surfaces: each adds the square of its share times its change.
    scene = TwoLayers(np.array(alpha), front, back, sigma)
    step = [squared_distance(Mixture(np.ones(1), each[:1], sigma),
                             Mixture(np.ones(1), each[1:], sigma)) for each in (front, back)]
    at_front, at_back, _ = scene.distances()
    assert at_front == pytest.approx((1 - alpha) ** 2 * step[1], rel=1e-6, abs=1e-12)
    assert at_back == pytest.approx(alpha ** 2 * step[0], rel=1e-6, abs=1e-12)


@pytest.mark.parametrize('alpha', [0.25, 0.3, 0.4, 0.45])
def test_counterexample_more_transparent_yet_more_likely(alpha):
    scene = counterexample(alpha)
    likelihood = scene.likelihood()
    assert alpha < 1 - alpha
    assert likelihood[FRONT] > likelihood[BACK]
    # It breaks one assumption alone, that of equal steps: the surfaces are far apart.
    assert scene.distances()[NEITHER] == pytest.approx(scene.distances()[:2].sum(), rel=1e-3)


def test_surfaces_of_like_colours_break_the_lemma_too():
    # Equal steps, but the front's second point has the colour of the back's first: at neither
    # depth the other view is then as like as at the back's.
    front = np.array([[0.3], [0.4]])
    back = np.array([[0.4], [0.3]])
    scene = TwoLayers(np.array([0.3, 0.5]), front, back, np.array([0.05]))
    distances = scene.distances()
    assert (distances[:, NEITHER] < distances[:, :2].sum(axis=1)).all()
    assert distances[1, NEITHER] == pytest.approx(0, abs=1e-12)  # the invalid depth fits best
    assert scene.likelihood()[1].argmax() == NEITHER


def test_rays_that_are_all_alike_have_no_likelihood():
    assert not depth_likelihood(np.zeros((4, 3))).any()


def test_likelihood_of_many_alphas_at_once():
    alpha = np.linspace(0, 1, 11)
    together = counterexample(alpha).likelihood()
    assert together.shape == (11, 3)
    np.testing.assert_allclose(together, [counterexample(each).likelihood() for each in alpha])
