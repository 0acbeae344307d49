"""Student's t of the errors of poses, which have longer tails than a Gaussian.

Its region of the level COMMON is that of the Gaussian whose covariance an estimate has. Its
smaller regions are smaller than the Gaussian's, its larger ones larger.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtr, chdtri, fdtr, fdtri

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
