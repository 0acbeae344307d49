"""A sample by a cheap likeness of a density, to learn where the density itself differs from it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.sampler import Gaussian, LogDensity, sample_posterior
from pmcl_ros.pmcl.weights import Weights

_PILOTS = 192  # particles, by the likeness
_ASKED = 32  # of them that are asked for the density
_ENOUGH = 4  # particles for each dimension, to know a covariance by
# How much of what the density says more a plane leaves open, relative to a usual slope; squared.
_RIDGE = 0.5
_DOUBT = 3.0  # answers that a height of its own outweighs, where there are too few for a plane
_WIDEN = 2.0  # standard deviations of what is begun in, relative to the pilots'


@dataclass(frozen=True)
class Tilt:
    """What a density adds to its likeness about a mode, to first order [nat].

    about: where it is expanded. slope: (d,) per unit of the tangent space. height: there.
    """

    about: Gaussian
    slope: NDArray[np.float64]
    height: float

    def __call__(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) of poses (n, 4, 4)."""
        off = self.about.symmetry.local(poses, self.about.pose) @ self.about.basis
        return np.asarray(self.height + off @ self.slope)


def piloted(rough: LogDensity, exact: LogDensity, starts: Sequence[Gaussian],
            rng: np.random.Generator) -> tuple[LogDensity, list[Gaussian]]:
    """A better likeness of `exact` than `rough`, and Gaussians to begin in.

    rough: costs next to nothing. starts: a Gaussian about each mode.
    A few particles that are far from where the density is do not come there in a few moves. So
    it is asked at some poses that its likeness finds likely: about each mode a plane is laid
    through what it says more, by ridge regression, and added to the likeness. The Gaussians are
    as wide and deep as the sample is, by the tilted likeness. What is sampled in the end by
    `exact` is the same with them: they only bring particles closer.
    """
    def nearest(at: NDArray[np.float64]) -> NDArray[np.int64]:
        likely = np.stack([each.log_density(at) for each in starts])
        return np.asarray(likely.argmax(axis=0))

    poses, values, _ = sample_posterior([rough], starts, _PILOTS, 1, rng, lambda _: True)
    asked = np.linspace(0, _PILOTS - 1, _ASKED).astype(int)  # modes come after each other
    more = np.full(_PILOTS, np.nan)
    more[asked] = exact(poses[asked]) - values[asked]
    more[~np.isfinite(more)] = np.nan
    usual = float(np.nanmean(more)) if np.isfinite(more).any() else 0.0
    of = nearest(poses)
    learned = [_learned(start, poses[of == k], more[of == k] - usual)
               for k, start in enumerate(starts)]

    def tilted(at: NDArray[np.float64]) -> NDArray[np.float64]:
        result, of = rough(at) + usual, nearest(at)
        for k, (tilt, _) in enumerate(learned):
            result[of == k] += tilt(at[of == k])
        return result

    return tilted, [begun for _, begun in learned]


def _learned(start: Gaussian, poses: NDArray[np.float64], more: NDArray[np.float64]
             ) -> tuple[Tilt, Gaussian]:
    """Of the pilots of one mode; more: (n,) what the density says more, NaN where not asked."""
    dimensions = start.basis.shape[1]
    known = np.isfinite(more)
    if len(poses) < _ENOUGH * dimensions:
        height = float(more[known].sum() / (known.sum() + _DOUBT))
        return Tilt(start, np.zeros(dimensions), height), start
    off = start.symmetry.local(poses, start.pose) @ start.basis
    centre = off.mean(axis=0)
    least = 1e-4 * start.spread @ start.spread.T  # where all pilots are one
    root = np.linalg.cholesky(np.cov(off.T) + least)
    normal = np.linalg.solve(root, (off[known] - centre).T).T
    terms = np.concatenate([np.ones((len(normal), 1)), normal], axis=1)
    ridge = _RIDGE * np.eye(dimensions + 1)
    height, *slopes = np.linalg.solve(terms.T @ terms + ridge, terms.T @ more[known])
    slope = np.linalg.solve(root.T, slopes)
    # The sample as the tilt weighs it; as it was, the fewer that leaves.
    weights = Weights(off @ slope)
    trusted = weights.effective_size / (weights.effective_size + 2 * dimensions)
    share = trusted * weights.normalised + (1 - trusted) / len(off)
    mean = share @ off
    covariance = (off - mean).T @ ((off - mean) * share[:, None]) + least
    better = Gaussian.of(retract(start.pose, (start.basis @ mean)[None])[0],
                         start.basis @ (_WIDEN ** 2 * covariance) @ start.basis.T, start.symmetry)
    return Tilt(start, slope, height - float(slope @ centre)), better
