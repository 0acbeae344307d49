"""Whether a view shows things where its pose says that it must."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole

_CORNERS = 400  # that are tracked at most
_LEAST = 20  # that must agree; fewer tell nothing
_STARTS = 4  # depths from which a corner is looked for, even in disparity
_SLACK = 1.0  # px: by which a track may come back beside its start
_NOISE = 0.5  # px: standard deviation of a good track
_FLAGS = cv2.OPTFLOW_USE_INITIAL_FLOW
_WINDOW, _LEVELS = (15, 15), 2


class Tracker:
    """Corners of the reference view, looked for in the others."""

    def __init__(self, reference: NDArray[np.float32], gamma: float) -> None:
        self._gamma = gamma
        self._picture = self._encoded(reference)
        found = cv2.goodFeaturesToTrack(self._picture, _CORNERS, 0.005, 5)
        self._corners = np.empty((0, 1, 2), np.float32) if found is None else found

    def residual(self, view: NDArray[np.float32], offset: NDArray[np.float64], pinhole: Pinhole,
                 near: float) -> float | None:
        """How far from where its pose allows them most tracked corners are [px].

        view: (height, width, 3) linear, rectified, of a camera at `offset` (3,) [m] in the
        reference's frame. A point of any depth is displaced along -f (x, y); what is across that
        is the pose's fault, or that of a track gone wrong. Wrong tracks lie anywhere, right ones
        together: the place where most lie counts. near: depth of what is nearest [m]. None where
        too few lie together.
        """
        whole = -offset[:2] * [pinhole.fx, pinhole.fy]  # px, times the inverse depth
        moved = self._moved(self._encoded(view), whole, near)
        length = float(np.linalg.norm(whole))
        if length / near < 2 * _NOISE:  # nothing is displaced, whatever its depth
            return _densest(moved)
        return _densest(moved @ np.array([[-whole[1]], [whole[0]]]) / length)

    def _moved(self, picture: NDArray[np.uint8], whole: NDArray[np.float64], near: float
               ) -> NDArray[np.float64]:
        """(n, 2) displacements [px] of the corners that were found again."""
        best = np.full(len(self._corners), np.inf)
        moved = np.zeros((len(self._corners), 2))
        for inverse in np.linspace(0, 1 / near, _STARTS) if len(self._corners) else ():
            start = self._corners + (whole * inverse).astype(np.float32)
            there, found, error = cv2.calcOpticalFlowPyrLK(
                self._picture, picture, self._corners, start, winSize=_WINDOW, maxLevel=_LEVELS,
                flags=_FLAGS)
            back, again, _ = cv2.calcOpticalFlowPyrLK(
                picture, self._picture, there, there - (whole * inverse).astype(np.float32),
                winSize=_WINDOW, maxLevel=_LEVELS, flags=_FLAGS)
            lost = np.linalg.norm(back - self._corners, axis=(1, 2)) > _SLACK
            cost = np.where((found[:, 0] > 0) & (again[:, 0] > 0) & ~lost, error[:, 0], np.inf)
            better = cost < best
            moved[better] = (there - self._corners)[better, 0]
            best = np.minimum(best, cost)
        return moved[np.isfinite(best)]

    def _encoded(self, picture: NDArray[np.float32]) -> NDArray[np.uint8]:
        grey = np.clip(picture.mean(axis=2), 0, 1) ** (1 / self._gamma)
        return np.asarray(np.rint(255 * grey), np.uint8)


def _densest(values: NDArray[np.float64]) -> float | None:
    """Distance from 0 of where most of values (n, k) lie; None where that are few."""
    if len(values) < _LEAST:
        return None
    squares = ((values[:, None] - values) ** 2).sum(axis=-1) / _NOISE ** 2
    middle = int(np.argmax(np.exp(-squares / 2).sum(axis=1)))
    together = values[squares[middle] < 9]
    if len(together) < _LEAST:
        return None
    return float(np.linalg.norm(np.median(together, axis=0)))
