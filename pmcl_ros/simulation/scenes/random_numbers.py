"""Random numbers for compiled loops: the same for a seed, whichever thread asks."""

import numpy as np

from pmcl_ros.runtime.kernels import compiled

_GOLDEN, _ONE, _TWO = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB
_SCALE = 2.0 ** -53


@compiled()
def chance(state):  # type: ignore[no-untyped-def]
    """Uniform in [0, 1): splitmix64 (Steele, Lea, Flood 2014); state: (1,) uint64, moved on."""
    state[0] += np.uint64(_GOLDEN)
    x = state[0]
    x = (x ^ (x >> np.uint64(30))) * np.uint64(_ONE)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(_TWO)
    x = x ^ (x >> np.uint64(31))
    return np.float64(x >> np.uint64(11)) * _SCALE
