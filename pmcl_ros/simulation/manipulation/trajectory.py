"""Times for a path of the arm."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.simulation.manipulation.fetch_arm import STEP, VELOCITIES

_SMOOTH = 0.15  # s: twice averaged over this time, so speeds rise and fall slowly


def timed(path: NDArray[np.float64], speed: float) -> NDArray[np.float64]:
    """Postures (m, 7), one for each step of the physics, along a path (n, 7) [rad].

    speed: share of the joints' velocity limits that the fastest joint keeps to.
    """
    spans = (abs(np.diff(path, axis=0)) / VELOCITIES).max(axis=1) / speed
    at = np.concatenate([[0.0], np.cumsum(spans)])
    times = np.arange(0, at[-1] + STEP, STEP)
    even = np.stack([np.interp(times, at, joint) for joint in path.T], axis=1)
    width = int(_SMOOTH / STEP)
    for _ in range(2):
        padded = np.concatenate([np.repeat(even[:1], width, 0), even,
                                 np.repeat(even[-1:], width, 0)])
        sums = np.cumsum(padded, axis=0)
        even = (sums[width:] - sums[:-width]) / width
    return even
