"""Smooth paths of rigid bodies."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

_WAVES = 3  # sines that an axis' motion is the sum of
_FINE = 4000  # places where the speed of a path is looked at
_LONG = 200.0  # rad of the slowest wave's phase that are looked at


def wander(rng: np.random.Generator, frames: int, reach: NDArray[np.float64], turn: float,
           speed: float) -> NDArray[np.float64]:
    """(frames, 4, 4) poses near the identity: sums of sines along and about x, y, z.

    reach: (3,) how far the origin goes at most [m]. turn: by how much about each axis [rad].
    speed: the origin's largest step from frame to frame [m]; 0: at rest.
    """
    rates = rng.uniform(0.6, 1.7, (6, _WAVES))
    phases = rng.uniform(0, 2 * np.pi, (6, _WAVES))
    sizes = rng.dirichlet(np.full(_WAVES, 3.0), 6) * np.append(reach, np.full(3, turn))[:, None]
    poses = np.tile(np.eye(4), (frames, 1, 1))
    if speed == 0:
        return poses
    fine = np.linspace(0, _LONG, _FINE)[:, None, None]
    slopes = (sizes * rates * np.cos(rates * fine + phases)).sum(axis=2)
    step = speed / np.linalg.norm(slopes[:, :3], axis=1).max()
    time = step * np.arange(frames)[:, None, None]
    way = (sizes * np.sin(rates * time + phases)).sum(axis=2)
    poses[:, :3, 3] = way[:, :3]
    poses[:, :3, :3] = Rotation.from_rotvec(way[:, 3:]).as_matrix()
    return poses
