"""The posterior of tracking: a prior times the evidence of one view, sampled."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.posterior import ContourPosterior, Mode, Posterior
from pmcl_ros.pmcl.sampler import Gaussian, sample_posterior

# Standard deviations of the initial Gaussian about a mode, relative to the local model's. The
# search of the region takes 2.5, which 64 particles do not fill.
_WIDEN = 1.5
_NEGLIGIBLE = 10.0  # nat: log mass of a mode below that of the best one
_MOVES = 1  # Metropolis moves of the sampler after each step in temperature


def sample_near(posterior: ContourPosterior, prior: Gaussian, modes: list[Mode], count: int,
                rng: np.random.Generator) -> Posterior:
    """`count` particles of a prior times the evidence of one view, about modes near the prior.

    modes: at least one, best first.
    """
    symmetry, scale = posterior.model.symmetry, modes[0].local.scale

    def log_prior(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        return -0.5 * prior.square_distance(poses)

    def exact(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        return scale * posterior.exact(poses) + log_prior(poses)

    starts = [_start(posterior, prior, mode) for mode in modes]
    # Drop negligible modes: their wide Gaussians would claim the best mode's region, where their
    # linearized contour is wrong.
    peaks = scale * posterior.exact(np.stack([mode.pose for mode in modes]))
    masses = peaks + [log_volume(prior, mode, start)
                      for mode, start in zip(modes, starts, strict=True)]
    kept = np.flatnonzero(masses >= masses.max() - _NEGLIGIBLE)
    modes, starts = [modes[k] for k in kept], [starts[k] for k in kept]
    scale = modes[0].local.scale
    contours = [posterior.linearize_at(mode.pose) for mode in modes]

    def rough(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """By the linearized contour of the mode whose Gaussian is densest at a pose."""
        nearest = np.stack([each.log_density(poses) for each in starts]).argmax(axis=0)
        values = np.zeros(len(poses))
        for k, (mode, contour) in enumerate(zip(modes, contours, strict=True)):
            own = nearest == k
            values[own] = contour.evidence(symmetry.local(poses[own], mode.pose))
        inside = posterior.feasible(poses)
        return np.where(inside, scale * values + log_prior(poses), -np.inf)

    poses, values, own = sample_posterior([rough, exact], starts, count, _MOVES, rng,
                                          lambda _: True)
    return Posterior(tuple(modes), poses, values, own)


def _start(posterior: ContourPosterior, prior: Gaussian, mode: Mode) -> Gaussian:
    """The initial Gaussian of a mode: its product with the prior.

    Its mean is the mode itself where the mean of the product is outside of the region.
    """
    both = product(prior, mode, _WIDEN)
    return both if posterior.feasible(both.pose[None])[0] else replace(both, pose=mode.pose)


def product(prior: Gaussian, mode: Mode, widen: float) -> Gaussian:
    """The product of the prior and the Gaussian of a mode, with the mode's widened."""
    local = mode.local
    information = local.scale * local.information
    root = np.linalg.inv(prior.spread) @ prior.basis.T @ local.basis
    expected = root.T @ root
    off = local.basis.T @ prior.symmetry.local(prior.pose[None], mode.pose)[0]
    step = local.basis @ np.linalg.solve(information + expected, expected @ off)
    wide = local.basis @ np.linalg.inv(information / widen ** 2 + expected) @ local.basis.T
    return Gaussian.from_covariance(retract(mode.pose, step[None])[0], wide, prior.symmetry)


def log_volume(prior: Gaussian, mode: Mode, product: Gaussian) -> float:
    """Log of a mode's volume under the prior, by Laplace's approximation, unnormalised."""
    from_mode = mode.local.basis.T @ prior.symmetry.local(product.pose[None], mode.pose)[0]
    information = mode.local.scale * mode.local.information
    return float(-0.5 * (from_mode @ information @ from_mode
                         + prior.square_distance(product.pose[None])[0])
                 + np.linalg.slogdet(product.spread)[1])
