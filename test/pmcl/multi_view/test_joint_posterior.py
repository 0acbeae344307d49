"""Samples of the posterior by several views, on modes of which it is known."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from quadratic_evidence import SCALE, assert_sampled, mode_at
from scipy.special import softmax
from test_multi_view import BRACKET, around, maps_seen, settings, truth_of

from pmcl_ros.evidence.learned import learned_views
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
def opened(context):
    """A function -> of two views. too_far_in: of contours [px]. strength: of their evidence."""
    with contextlib.ExitStack() as stack:
        def opened(too_far_in=0, numbers=None, strength=1):
            evidence = maps_seen(context, BRACKET, HERE, around([-20, 20]), too_far_in=too_far_in)
            evidence = replace(evidence, views=tuple(replace(each, evidence=replace(
                each.evidence, tensor=strength * each.evidence.tensor))
                for each in evidence.views))
            joint = JointEvidence.from_views(evidence, NumbaRenderer(), BRACKET, settings())
            return JointPosterior.opened(joint, settings(particles=4000), numbers, stack)
        yield opened


@pytest.fixture
def posterior(opened):
    """The modes do not come from its views."""
    return opened()


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


def test_likelihoods_are_of_the_evidence_scaled_as_about_the_best_pose(opened):
    posterior = opened(strength=8)
    poses = posterior.contours.joint.seen(np.stack([aside(0.002, 0, 0), HERE, aside(0, 0.003, 0)]))
    evidence = np.array([posterior.evidence_at(each) for each in poses])
    assert evidence.argmax() == 1
    scale = posterior.fitted_at(poses[1]).scale
    assert scale < 0.9
    np.testing.assert_allclose(posterior.log_likelihoods(poses), scale * evidence)


def test_views_are_said_to_fit_with_the_displacement_that_all_contours_have(opened):
    numbers = learned_views().model_copy(update={'displacement': 0.35})
    posterior = opened(2, numbers)
    mode = posterior.refine(posterior.contours.joint.seen(HERE))
    fits = posterior.fits_at(mode.pose)
    plain = posterior.contours.fits(mode.pose, posterior.contours.nominal)
    assert max(each.off for each in fits) < 0.5 * min(each.off for each in plain)
    assert min(each.evidence for each in fits) > max(each.evidence for each in plain)


def test_a_mode_has_the_share_of_the_model_error_by_which_its_views_disagree(opened):
    numbers = learned_views().model_copy(update={'displacement': 0.0})
    known, plain = opened(2, numbers), opened(2)
    mode, other = (each.refine(each.contours.joint.seen(HERE)) for each in (known, plain))
    np.testing.assert_array_equal(mode.pose, other.pose)
    share = known.error_share_near(mode.pose)
    assert share == numbers.share(known.contours.joint.independent,
                                  known.disagreement_near(mode.pose))
    assert abs(share - 1) > 0.1
    np.testing.assert_allclose(mode.local.model_error, share * other.local.model_error)
