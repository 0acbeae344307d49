"""Student's t of the errors of poses, which have longer tails than a Gaussian.

Its region of the level COMMON is that of the Gaussian whose covariance an estimate has. Its
smaller regions are smaller than the Gaussian's, its larger ones larger.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtr, chdtri, fdtr, fdtri, ndtr

from pmcl_ros.geometry.halton import normal_points

COMMON = 0.9  # level of the region that the Gaussian and the Student's t share


def credible_level(squares: ArrayLike, dimensions: ArrayLike, degrees_of_freedom: float
                   ) -> NDArray[np.float64]:
    """(n,) levels, 0 to 1, of the smallest regions that hold what is so far off.

    squares: (n,) squared Mahalanobis distances by the Gaussian's covariance. dimensions: (n,) of
    each. degrees_of_freedom: of the Student's t; inf: the Gaussian.
    """
    d, square = np.asarray(dimensions, float), np.asarray(squares, float)
    if math.isinf(degrees_of_freedom):
        return np.asarray(chdtr(d, square))
    scale = d * shape_scale(d, degrees_of_freedom)
    return np.asarray(fdtr(d, degrees_of_freedom, square / scale))


def shape_scale(dimensions: ArrayLike, degrees_of_freedom: float) -> NDArray[np.float64]:
    """(n,) factor from the Gaussian's covariance to the scale matrix of the Student's t."""
    d = np.asarray(dimensions, float)
    return np.asarray(chdtri(d, 1 - COMMON) / (d * fdtri(d, degrees_of_freedom, COMMON)))


def tail_factors(count: int, dimensions: int, degrees_of_freedom: float,
                 rng: np.random.Generator) -> NDArray[np.float64]:
    """(count,) factors that turn deviations of the Gaussian into those of the Student's t."""
    precision = rng.chisquare(degrees_of_freedom, count) / degrees_of_freedom
    return np.sqrt(shape_scale(dimensions, degrees_of_freedom) / precision)


def median_length(covariance: NDArray[np.float64], dimensions: int = 3,
                  degrees_of_freedom: float = math.inf) -> float:
    """The median length of an error in space, by 4,096 points that are the same each time.

    covariance: (3, 3) of it, in the square of its unit; NaN where that is not finite. dimensions:
    of the error that it is a part of. degrees_of_freedom: of the Student's t with the same 90 %
    region as the Gaussian with that covariance; inf: of the Gaussian.
    """
    if not np.isfinite(covariance).all():
        return math.nan
    points = _points()
    squares = np.square(points[:, :3]) @ np.linalg.eigvalsh(covariance).clip(0)
    if not math.isinf(degrees_of_freedom):
        precision = chdtri(degrees_of_freedom, ndtr(points[:, 3])) / degrees_of_freedom
        squares = squares * shape_scale(dimensions, degrees_of_freedom) / precision
    return float(np.sqrt(np.median(squares)))


@lru_cache(maxsize=1)
def _points() -> NDArray[np.float64]:
    """(4096, 4) standard normal numbers."""
    return normal_points(4096, 4, np.random.default_rng(0))
