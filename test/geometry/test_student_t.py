"""Student's t whose 90 % region is a Gaussian's."""

import math

import numpy as np
import pytest
from scipy.stats import chi2, kstest, multivariate_t, norm

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.student_t import (
    COMMON,
    credible_level,
    median_length,
    shape_scale,
    tail_factors,
)
from pmcl_ros.geometry.symmetry import Symmetry


def test_without_tails_it_is_the_gaussian():
    squares = np.array([0.0, 1, 4, 9, 30])
    np.testing.assert_allclose(credible_level(squares, 5, math.inf), chi2.cdf(squares, 5))
    np.testing.assert_allclose(credible_level(squares, 5, 1e7), chi2.cdf(squares, 5), atol=1e-5)


@pytest.mark.parametrize('degrees', [1.0, 4.0, 50.0])
def test_the_region_in_common_is_that_of_the_gaussian(degrees):
    dimensions = np.array([5, 6])
    squares = chi2.ppf(COMMON, dimensions)
    np.testing.assert_allclose(credible_level(squares, dimensions, degrees), COMMON, atol=1e-9)
    assert (credible_level(squares / 3, dimensions, degrees)
            > chi2.cdf(squares / 3, dimensions)).all()
    assert (credible_level(3 * squares, dimensions, degrees)
            < chi2.cdf(3 * squares, dimensions)).all()


@pytest.mark.parametrize('degrees', [2.0, 4.0])
def test_levels_of_scipys_draws_are_uniform(degrees):
    shape = shape_scale(5, degrees) * np.eye(5)
    draws = multivariate_t(np.zeros(5), shape, degrees, seed=0).rvs(4000)
    assert kstest(credible_level((draws ** 2).sum(axis=1), 5, degrees), 'uniform').pvalue > 0.01


def test_factors_make_draws_of_a_gaussian_those_of_the_t():
    rng = np.random.default_rng(1)
    draws = rng.normal(size=(4000, 6)) * tail_factors(4000, 6, 4.0, rng)[:, None]
    assert kstest(credible_level((draws ** 2).sum(axis=1), 6, 4.0), 'uniform').pvalue > 0.01


def test_the_level_of_a_pose_has_the_tails():
    sigma = np.array([0.001, 0.002, 0.006, 0.02, 0.03, 0.01])
    off = retract(np.eye(4), 0.5 * sigma[None])[0]
    level = Symmetry(None).credible_level(off, np.eye(4), np.diag(sigma ** 2), 4.0)
    assert level == pytest.approx(float(credible_level(6 * 0.25, 6, 4.0)), rel=1e-3)


@pytest.mark.parametrize(('variances', 'expected'), [
    ([4, 4, 4], 2 * np.sqrt(chi2.ppf(0.5, 3))), ([4, 4, 0], 2 * np.sqrt(chi2.ppf(0.5, 2))),
    ([4, 0, 0], 2 * norm.ppf(0.75)), ([0, 0, 0], 0)])
def test_the_median_length_of_a_gaussian_however_it_lies(variances, expected):
    for seed in range(3):
        turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
        found = median_length(turn @ np.diag(variances) @ turn.T)
        assert found == pytest.approx(expected, rel=0.005)
    assert math.isnan(median_length(np.full((3, 3), math.nan)))


@pytest.mark.parametrize('dimensions', [5, 6])
def test_the_median_length_of_a_part_of_a_students_t(dimensions):
    covariance = np.diag([1.0, 4, 36, 9, 2, 1][:dimensions])
    draws = multivariate_t(np.zeros(dimensions), shape_scale(dimensions, 4.0) * covariance, 4.0,
                           seed=0).rvs(100_000)
    expected = np.median(np.linalg.norm(draws[:, :3], axis=1))
    found = median_length(covariance[:3, :3], dimensions, 4.0)
    assert found == pytest.approx(expected, rel=0.01)
    assert found < 0.8 * median_length(covariance[:3, :3])
    assert median_length(covariance[:3, :3], dimensions, 1e7) == pytest.approx(
        median_length(covariance[:3, :3]), rel=0.001)
