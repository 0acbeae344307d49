"""Particles: importance weights in log space, resampling, initial poses, perturbation."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of, retract
from pmcl_ros.pmcl.prior.orientation import Orientation
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.runtime.errors import LocalizationError


@dataclass(frozen=True)
class Weights:
    """Weights of n particles.

    log: (n,) unnormalised log weights; NaN counts as no weight at all.
    """

    log: NDArray[np.float64]

    def __post_init__(self) -> None:
        clean = np.where(np.isnan(self.log), -np.inf, np.asarray(self.log, float))
        if clean.ndim != 1 or not len(clean):
            raise LocalizationError('weights must be one row of numbers, got shape '
                                    f'{self.log.shape}')
        if not np.isfinite(clean.max()):
            # No particle explains anything: all weigh the same.
            clean = np.zeros(len(clean))
        object.__setattr__(self, 'log', clean - clean.max())

    @classmethod
    def from_values(cls, values: NDArray[np.floating]) -> 'Weights':
        """Weights proportional to non-negative values."""
        with np.errstate(divide='ignore', invalid='ignore'):
            return cls(np.log(np.asarray(values, float)))

    @classmethod
    def tempered(cls, scores: NDArray[np.floating], largest: float, effective: float
                 ) -> tuple['Weights', float]:
        """Weights exp(beta score), and beta: the largest with an effective size of n `effective`.

        scores: (n,). effective: 0 to 1. beta is `largest` at most.
        """
        values = np.asarray(scores, np.float64)
        enough = effective * len(values)
        low, high = 0.0, largest
        if cls(high * values).effective_size >= enough:
            return cls(high * values), high
        for _ in range(40):
            beta = (low + high) / 2
            if cls(beta * values).effective_size >= enough:
                low = beta
            else:
                high = beta
        with np.errstate(invalid='ignore'):  # 0 times -inf
            return cls(low * values), low

    @cached_property
    def normalised(self) -> NDArray[np.float64]:
        """(n,), sum 1."""
        weights = np.exp(self.log)
        return weights / weights.sum()

    @cached_property
    def log_normalised(self) -> NDArray[np.float64]:
        """(n,), the logarithms of `normalised`, also where those are too small for a number."""
        return self.log - np.log(np.exp(self.log).sum())

    @property
    def effective_size(self) -> float:
        """Kish's effective number of particles, 1 to n."""
        return float(1 / (self.normalised ** 2).sum())

    def resample(self, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """(count,) indices of particles drawn in proportion to their weights.

        Systematic resampling: each is drawn its share of `count` times, up to rounding.
        """
        ladder = np.cumsum(self.normalised)
        positions = (rng.random() + np.arange(count)) / count
        # Particles of weight 0 are never drawn, also not the last one.
        drawn = np.searchsorted(ladder / ladder[-1], positions, side='right')
        return np.minimum(drawn, np.flatnonzero(self.normalised)[-1])


def uniform_poses(region: Region, count: int, rng: np.random.Generator,
                  orientation: Orientation | None = None) -> NDArray[np.float64]:
    """(count, 4, 4) poses, origins uniform in the region, orientations uniform over SO(3).

    orientation: in place of SO(3), if given.
    """
    places = np.array(region.center) + (rng.random((count, 3)) - 0.5) * region.size
    return pose_of(Rotation.random(count, rng) if orientation is None
                   else orientation.draw(count, rng), places)


def perturb(poses: NDArray[np.float64], translation: NDArray[np.floating] | float,
            rotation: NDArray[np.floating] | float, rng: np.random.Generator
            ) -> NDArray[np.float64]:
    """Poses moved by zero-mean Gaussians in the six degrees of freedom.

    Paper, section V: the action model.
    translation: standard deviation along x, y, z of the camera's frame [m].
    rotation: about these axes through the object's origin [rad].
    """
    shift = rng.normal(size=(len(poses), 3)) * translation
    turn = rng.normal(size=(len(poses), 3)) * rotation
    return retract(poses, np.concatenate([shift, turn], axis=1))
