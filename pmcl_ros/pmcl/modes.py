"""When two poses are of one mode of the posterior."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.summary import same_mode

DISTANCE, ANGLE = 0.01, 0.15  # m, rad: closer poses are of one mode


def same_mode_of(poses: NDArray[np.float64], pose: NDArray[np.float64], symmetry: Symmetry
          ) -> NDArray[np.bool_]:
    """(n,) which of poses (n, 4, 4) are of the mode of `pose` (4, 4)."""
    return same_mode(symmetry.folded(poses, pose), pose, symmetry.axis, DISTANCE, ANGLE)


def suppress_duplicates(poses: NDArray[np.float64], symmetry: Symmetry, count: int) -> list[int]:
    """Which of poses (n, 4, 4), best first, are not of an earlier one's mode: `count` at most.
    """
    kept: list[int] = []
    for k, pose in enumerate(poses):
        if not same_mode_of(poses[kept], pose, symmetry).any():
            kept.append(k)
        if len(kept) == count:
            break
    return kept
