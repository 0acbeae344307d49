"""Samples of the posterior by several views, on modes of which it is known."""

import contextlib

import numpy as np
import pytest
from quadratic_evidence import SCALE, assert_sampled, mode_at
from scipy.special import softmax
from test_multi_view import BRACKET, around, maps_seen, settings, truth_of

from pmcl_ros.geometry.se3 import local
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.multi_view.joint_posterior import JointPosterior, mixture
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.sampler import Gaussian

HERE = truth_of(BRACKET)
SIGMA = np.array([0.003, 0.002, 0.004, 0.02, 0.02, 0.03])


def aside(*by):
    pose = HERE.copy()
    pose[:3, 3] += by
    return pose


def modes(more):
    """The first is twice as wide in each of six dimensions; the second has more evidence [nat]."""
    return [mode_at(aside(0.004, 0, -0.002), 20.0, 2 * SIGMA),
            mode_at(aside(-0.03, 0.01, 0), 20.0 + more / SCALE, SIGMA)]


@pytest.fixture
def posterior(context):
    """Of two views; the modes do not come from them."""
    evidence = maps_seen(context, BRACKET, HERE, around([-20, 20]))
    joint = JointEvidence.from_views(evidence, NumbaRenderer(), BRACKET, settings())
    with contextlib.ExitStack() as stack:
        yield JointPosterior.opened(joint, settings(particles=4000), None, stack)


def test_without_a_prior_modes_weigh_by_evidence_and_volume(posterior):
    sample = posterior.sample(modes(4.0), np.random.default_rng(0), lambda _: True)
    flat = Gaussian.from_covariance(HERE, 1e6 * np.eye(6), BRACKET.symmetry)
    assert_sampled(sample, flat, 0.1)


def test_near_a_prior_they_weigh_by_what_it_leaves_of_them(posterior):
    wide = np.diag(np.repeat([0.01, 0.05], 3) ** 2)
    prior = Gaussian.from_covariance(aside(0.01, 0, 0), wide, BRACKET.symmetry)
    sample = posterior.sample_near(prior, modes(10.5), 4000, np.random.default_rng(0))
    assert_sampled(sample, prior, 0.1)


@pytest.mark.parametrize('count', [2000, 1001, 1])
def test_a_mixture_has_the_shares_means_and_densities_of_its_gaussians(count):
    masses = [1.0, 2.0, 0.5]
    gaussians = [Gaussian.from_covariance(aside(0.05 * k, 0, 0), np.diag((k + 1) * SIGMA ** 2),
                                          BRACKET.symmetry) for k in range(3)]
    sample = mixture([*modes(0.0), *modes(0.0)[:1]], gaussians, masses, count,
                     np.random.default_rng(0))
    assert len(sample.poses) == len(sample.values) == len(sample.own) == count
    for number, (each, mass) in enumerate(zip(gaussians, masses, strict=True)):
        own = sample.own == number
        np.testing.assert_allclose(sample.values[own], mass + each.log_density(sample.poses[own]))
        if count % 2 == 0:  # in pairs on both sides of it
            assert abs(own.mean() - softmax(masses)[number]) < 0.05
            np.testing.assert_allclose(local(sample.poses[own], each.pose).mean(axis=0), 0,
                                       atol=1e-12)
