"""How well a followed object is usually seen: what tells that it is hidden, or something else."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.estimate import PoseEstimate

# Captures that are remembered, and that say enough; how many standard deviations below its mean is
# unlikely.
_REMEMBERED, _ENOUGH = 30, 10
_UNLIKELY = 3.0


class UsualLook:
    """Support and evidence of the contour, in the captures in which the object was seen."""

    def __init__(self) -> None:
        self._seen_with: deque[tuple[float, float]] = deque(maxlen=_REMEMBERED)

    @property
    def known(self) -> bool:
        """Whether it was seen often enough to say what is usual."""
        return len(self._seen_with) >= _ENOUGH

    def forget(self) -> None:
        """As if it had never been seen."""
        self._seen_with.clear()

    def remember(self, estimate: PoseEstimate) -> None:
        """It was seen so."""
        self._seen_with.append((estimate.support, estimate.evidence))

    def held(self, estimate: PoseEstimate, least: float) -> NDArray[np.bool_]:
        """(2,) whether support and evidence are not unlikely, by what they have been.

        least: of their standard deviations [nat / px]. True where that is not known.
        """
        if not self.known:
            return np.ones(2, bool)
        scatter = np.maximum(np.std(self._seen_with, axis=0), least)
        return np.array([estimate.support, estimate.evidence] >= (
            np.mean(self._seen_with, axis=0) - _UNLIKELY * scatter))
