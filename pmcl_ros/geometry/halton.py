"""Points that fill a Gaussian more evenly than random ones do: a scrambled Halton sequence.

The digits are those of `scipy.stats.qmc`, without scipy.stats: to import that takes a fifth of the
start of a process.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

_PRIMES = (2, 3, 5, 7, 11, 13)  # one base for each dimension of a tangent space
_BITS = 54  # digits beyond them do not change a float64 below 1


def normal_points(count: int, dimensions: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(count, dimensions) standard normal numbers, of at most six dimensions.

    rng: has another child (`Generator.spawn`) after it; its own numbers stay the same.
    """
    child, = rng.spawn(1)
    uniform = np.stack([_scrambled(count, base, child) for base in _PRIMES[:dimensions]], axis=1)
    return np.asarray(ndtri(0.5 + (1 - 1e-10) * (uniform - 0.5)))  # finite at 0 too


def _scrambled(count: int, base: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(count,) of 0 to 1: 0, 1, 2, ... with their digits mirrored at the point, and permuted.

    Each digit has a permutation of its own (Owen 2017, A randomized Halton algorithm in R).
    """
    permutations = np.tile(np.arange(base), (math.ceil(_BITS / math.log2(base)) - 1, 1))
    for each in permutations:
        rng.shuffle(each)
    rest, place, values = np.arange(count), 1.0, np.zeros(count)
    for each in permutations:
        rest, digit = np.divmod(rest, base)
        place /= base
        values += each[digit] * place
    return values
