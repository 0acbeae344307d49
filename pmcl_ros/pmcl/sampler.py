"""A sample of the posterior by sequential Monte Carlo, started from Gaussians about its modes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pmcl_ros.geometry.halton import normal_points
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.history import Record
from pmcl_ros.pmcl.particles import Weights
from pmcl_ros.runtime.progress import Progress

LogDensity = Callable[[NDArray[np.float64]], NDArray[np.float64]]

_EFFECTIVE = 0.5  # of the particles that one step in temperature leaves effective
_ACCEPTED = 0.3  # of the moves: about where a random walk in five or six dimensions mixes fastest
_MOST_STEPS = 30  # in temperature; a start that fits needs two to five


@dataclass(frozen=True)
class Gaussian:
    """A normal density about a pose, in its tangent space (`Symmetry.tangent_basis`).

    pose: (4, 4). spread: (d, d), its columns a square root of the covariance.
    """

    pose: NDArray[np.float64]
    basis: NDArray[np.float64]
    spread: NDArray[np.float64]
    symmetry: Symmetry

    @classmethod
    def from_covariance(cls, pose: NDArray[np.float64], covariance: NDArray[np.float64],
                        symmetry: Symmetry) -> 'Gaussian':
        """covariance: (6, 6), of which the part about the axis of symmetry is left out."""
        basis = symmetry.tangent_basis(pose)
        return cls(pose, basis, np.linalg.cholesky(basis.T @ covariance @ basis), symmetry)

    def seen_from(self, camera: NDArray[np.float64]) -> 'Gaussian':
        """The same in the frame of a camera (4, 4), given in the frame of this."""
        into = np.linalg.inv(camera)
        root = np.kron(np.eye(2), into[:3, :3]) @ self.basis @ self.spread
        return Gaussian.from_covariance(into @ self.pose, root @ root.T, self.symmetry)

    def deviations(self, normal: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 6) tangent vectors of standard normal numbers (n, d)."""
        return normal @ self.spread.T @ self.basis.T

    @property
    def log_volume(self) -> float:
        """Log of the product of the standard deviations along the axes of the ellipsoid."""
        return float(np.log(np.abs(np.diag(self.spread))).sum())

    def log_density(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) of poses (n, 4, 4), but for a constant that all Gaussians of d dimensions share."""
        return -0.5 * self.square_distance(poses) - self.log_volume

    def square_distance(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) of poses (n, 4, 4) from the mean, squared, in standard deviations."""
        deviations = self.symmetry.local(poses, self.pose) @ self.basis
        return np.asarray((np.linalg.solve(self.spread, deviations.T) ** 2).sum(axis=0))


def sample_posterior(densities: Sequence[LogDensity], start: Sequence[Gaussian],
                     count: int, moves: int, rng: np.random.Generator, progress: Progress,
                     records: Sequence[Record | None] = ()
                     ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """`count` equally weighted poses (n, 4, 4), their log posterior (n,), index of the mode (n,).

    Sequential Monte Carlo (Del Moral, Doucet, Jasra 2006): tempering from the mixture of the start
    to the first density, and from each density to the next. Each step keeps half of the particles
    effective, and `moves` Metropolis moves follow it. The share of the particles about a mode
    converges to its share of the posterior.

    densities: log densities (n,) of poses (n, 4, 4), up to a constant; -inf where infeasible. The
        last is the posterior, those before approximate it at lower cost.
    start: Gaussians, one about each mode, wider than the mode; particles begin in equal shares,
        by numbers that fill a Gaussian more evenly than random ones do (Halton 1960, scrambled).
        Where none of them is feasible, they begin at the modes.
    records: for each density, a callback for the particles and their values, first and after each
        step.
    Ends early, with the current particles, when `progress` returns False.
    """
    # In blocks: every other number of a Halton sequence is not even.
    own = np.arange(count) * len(start) // count
    normal = normal_points(count, start[0].basis.shape[1], rng)
    middles = np.stack([each.pose for each in start])[own]
    poses = _displaced(start, middles, own, normal)

    def mixture(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(logsumexp([each.log_density(poses) for each in start], axis=0))

    size = 1.2 / normal.shape[1] ** 0.5
    bridges = list(pairwise([mixture, *densities]))
    for k, (before, after) in enumerate(bridges):
        power = 0.0
        known, values = before(poses), after(poses)
        if not np.isfinite(values).any():  # far wider than what is feasible
            poses = middles
            known, values = before(poses), after(poses)
        record = records[k] if records else None
        if record is not None:
            record(poses, values)
        for step in range(_MOST_STEPS):
            if power >= 1 or not progress((k + step / _MOST_STEPS) / len(bridges)):
                break
            gain = _ratio(values, known)
            possible = float(np.isfinite(gain).mean())  # the rest is out at any power
            weights, taken = Weights.tempered(gain, 1 - power, _EFFECTIVE * possible)
            power += taken
            drawn = weights.resample(count, rng)
            poses, values, known, own = poses[drawn], values[drawn], known[drawn], own[drawn]
            for _ in range(moves):
                tried = _displaced(start, poses, own, size * rng.normal(size=normal.shape))
                poses, known, values, accepted = _metropolis(
                    (poses, known, values), tried, before, after, power, rng)
                size *= np.exp(accepted - _ACCEPTED)
            if record is not None:
                record(poses, values)
    return poses, values, own


def _metropolis(particles: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
                tried: NDArray[np.float64], before: LogDensity, after: LogDensity, power: float,
                rng: np.random.Generator
                ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]:
    """The particles after a move each, to `tried` (n, 4, 4), and the share that moved.

    particles: poses (n, 4, 4), and what `before` and `after` are there (n,). The density is
    before^(1 - power) after^power. A move is tested by `before`, then by the rest: rejected moves
    cost less, and the distribution is the same (delayed acceptance; Christen and Fox 2005).
    """
    poses, known, values = particles
    chances = np.log(rng.random((2, len(poses))))
    tried_known, tried_values = before(tried), np.full(len(poses), -np.inf)
    hopeful = chances[0] < _ratio(tried_known, known)
    tried_values[hopeful] = after(tried[hopeful])
    held = np.maximum(_ratio(values, known), -1e300)  # one without a value may move anywhere
    gain = _ratio(tried_values, tried_known) - held
    accepted = hopeful & (chances[1] < power * gain)
    return (np.where(accepted[:, None, None], tried, poses),
            np.where(accepted, tried_known, known), np.where(accepted, tried_values, values),
            float(accepted.mean()))


def _displaced(start: Sequence[Gaussian], poses: NDArray[np.float64], own: NDArray[np.int64],
               normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4, 4) moved by their own Gaussian's deviations of `normal` (n, d)."""
    deviations = np.zeros((len(poses), 6))
    for k, each in enumerate(start):
        deviations[own == k] = each.deviations(normal[own == k])
    return retract(poses, deviations)


def _ratio(values: NDArray[np.float64], densities: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) log of the ratio of two densities, given their logs (n,); -inf where the first is 0."""
    none = np.full(len(values), -np.inf)
    return np.subtract(values, densities, out=none, where=np.isfinite(values))
