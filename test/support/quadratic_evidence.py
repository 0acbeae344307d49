"""Evidence that falls off quadratically about its modes, and its product with a Gaussian prior."""

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from pmcl_ros.geometry.se3 import local
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.posterior import Mode

SCALE = 0.25  # of the evidence, to a log likelihood


def mode_at(pose, evidence, sigma):
    """A mode whose likelihood has standard deviations sigma (6,), of an object without symmetry.

    evidence: there [nat].
    """
    information = np.diag(1 / np.square(sigma)) / SCALE
    return Mode(pose, LocalModel(evidence, 100.0, np.eye(6), np.zeros(6), information,
                                 information / SCALE, np.zeros((6, 6)), np.eye(6)))


def deviations(poses, mode):
    """(n, 6) of poses (n, 4, 4) from a mode."""
    return local(poses, mode.pose)


def value_about(mode, off):
    """(n,) evidence of poses that are off (n, 6) from a mode."""
    return mode.local.evidence - 0.5 * np.einsum('ni,ij,nj->n', off, mode.local.information, off)


def products(prior, modes):
    """The share of each mode in prior times evidence, and its mean (6,) and covariance (6, 6).

    prior: a `Gaussian`. Means are from the prior's pose. Turns are small, or about one axis.
    """
    spread = prior.spread @ prior.spread.T
    masses, moments = [], []
    for mode in modes:
        own = np.linalg.inv(SCALE * mode.local.information)
        off = local(mode.pose[None], prior.pose)[0]
        both = np.linalg.inv(np.linalg.inv(spread) + np.linalg.inv(own))
        moments.append((both @ np.linalg.solve(own, off), both))
        # the likelihood's own integral, and that of two normal densities
        masses.append(SCALE * mode.local.evidence + 0.5 * np.linalg.slogdet(own)[1]
                      + multivariate_normal(cov=spread + own).logpdf(off))
    return np.exp(masses - logsumexp(masses)), moments


def assert_sampled(posterior, prior, atol=0.2):
    """The particles of each mode have its share, mean and covariance.

    atol: of means and covariances, in standard deviations.
    """
    shares, moments = products(prior, posterior.modes)
    for number, (share, (mean, covariance)) in enumerate(zip(shares, moments, strict=True)):
        ours = posterior.own == number
        assert share > 0.1
        assert abs(ours.mean() - share) < 0.05
        off = local(posterior.poses[ours], prior.pose)
        sigma = np.sqrt(np.diag(covariance))
        np.testing.assert_allclose((off.mean(axis=0) - mean) / sigma, 0, atol=atol)
        np.testing.assert_allclose(np.cov(off.T) / np.outer(sigma, sigma),
                                   covariance / np.outer(sigma, sigma), atol=atol)
