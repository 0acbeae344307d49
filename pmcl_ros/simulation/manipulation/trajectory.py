"""Times for a path of the arm."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.simulation.manipulation.fetch_arm import STEP, VELOCITIES

_SMOOTH = 0.15  # s: twice averaged over this time, so speeds rise and fall slowly
_CORNER = 0.8  # cosine: of steps that turn by more


def timed(path: NDArray[np.float64], speed: float) -> NDArray[np.float64]:
    """Postures (m, 7), one for each step of the physics, along a path (n, 7) [rad].

    speed: share of the joints' velocity limits that the fastest joint keeps to. The arm stops at
    corners of the path: it does not cut them.
    """
    path = path[np.append(True, (np.diff(path, axis=0) != 0).any(axis=1))]
    steps = np.diff(path, axis=0)
    along = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    corners = 1 + np.flatnonzero((along[1:] * along[:-1]).sum(axis=1) < _CORNER)
    ends = [0, *corners.tolist(), len(path) - 1]
    return np.concatenate([_smooth(path[a:b + 1], speed) for a, b in pairwise(ends)])


def _smooth(path: NDArray[np.float64], speed: float) -> NDArray[np.float64]:
    """Of a piece without corners, from rest to rest."""
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
