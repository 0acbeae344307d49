"""How well a followed object is usually seen: what tells that it is hidden, or something else."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.estimate import PoseEstimate

_REMEMBERED, _ENOUGH = 30, 10  # captures: that are remembered, that say enough
_UNLIKELY = 3.0  # standard deviations below the mean
_AMONG = 2 ** 0.5  # likewise of both, root of the sum of squares: still as usual
_LEAST = 0.2  # nat / px: of these standard deviations


class TrackStatistics:
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

    def fade(self) -> None:
        """It was not seen: the oldest look is forgotten, as it may look different by now."""
        if self._seen_with:
            self._seen_with.popleft()

    def remember(self, estimate: PoseEstimate) -> None:
        """It was seen so."""
        if np.isfinite([estimate.support, estimate.evidence]).all():
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

    def typical(self, estimate: PoseEstimate) -> bool:
        """Whether it is known what is usual, and this is well among it."""
        if not self.known:
            return False
        less = (np.mean(self._seen_with, axis=0) - [estimate.support, estimate.evidence]
                ) / np.maximum(np.std(self._seen_with, axis=0), _LEAST)
        return bool(np.linalg.norm(np.maximum(less, 0)) <= _AMONG)

    def half_there(self, estimate: PoseEstimate) -> bool:
        """Whether it has half of the usual evidence at least, or that is not known."""
        return not self.known or bool(
            estimate.evidence >= max(np.mean(self._seen_with, axis=0)[1], 0) / 2)
