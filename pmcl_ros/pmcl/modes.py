"""When two poses are the same, and the suppression of duplicates."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.symmetry import Symmetry

# Limits of translation [m] and rotation [rad] for `Symmetry.same_mode`, the only ones there are.
# Maxima of the evidence that are closer merge under refinement.
SAME_MODE = 0.01, 0.15
# Particles of one mode: a mode's posterior is as wide as this.
MODE_EXTENT = 0.02, 0.25
# Proposals: as far as the templates' steps are apart (7.5 degrees, 3 % of depth).
SAME_PROPOSAL = 0.012, 0.2
# Candidates of several objects, which are refined: closer ones differ by noise.
SAME_CANDIDATE = 0.005, 0.1


def suppress_duplicates(poses: NDArray[np.float64], symmetry: Symmetry, count: int) -> list[int]:
    """Non-maximum suppression: which of poses (n, 4, 4), best first, to keep; `count` at most.

    A pose is dropped when it is of the mode of one that is kept.
    """
    kept: list[int] = []
    for k, pose in enumerate(poses):
        if not symmetry.same_mode(poses[kept], pose, *SAME_MODE).any():
            kept.append(k)
        if len(kept) == count:
            break
    return kept
