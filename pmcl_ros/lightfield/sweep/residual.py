"""Whether a view shows things where its pose says that it must."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.geometry import Pinhole

_CORNERS, _LEAST = 300, 20  # that are tracked; fewer tell nothing
_SLACK = 2.0  # px: by which a track may come back beside its start
_NEAREST = 2.0  # times the inverse of `near`: what lies nearer is not expected


class Tracker:
    """Corners of the reference view, looked for in the others."""

    def __init__(self, reference: NDArray[np.float32], gamma: float) -> None:
        self._gamma = gamma
        self._picture = self._encoded(reference)
        found = cv2.goodFeaturesToTrack(self._picture, _CORNERS, 0.01, 5)
        self._corners = np.empty((0, 1, 2), np.float32) if found is None else found

    def residual(self, view: NDArray[np.float32], offset: NDArray[np.float64], pinhole: Pinhole,
                 near: float, focus: float) -> float | None:
        """Median distance [px] of tracked corners from the nearest place that a depth explains.

        view: (height, width, 3) linear, rectified, of a camera at `offset` (3,) [m] in the
        reference's frame. A point's displacement is -f (x, y) / depth: on a line, and between
        those of half of `near` and infinity. None where too few corners can be tracked.
        """
        if len(self._corners) < _LEAST:
            return None
        whole = -offset[:2] * [pinhole.fx, pinhole.fy]  # px, times the inverse depth
        picture = self._encoded(view)
        size = max(9, round(min(picture.shape) / 25)) | 1
        start = self._corners + (whole / focus).astype(np.float32)
        there, found, _ = cv2.calcOpticalFlowPyrLK(
            self._picture, picture, self._corners, start.copy(), winSize=(size, size), maxLevel=3,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
        back, again, _ = cv2.calcOpticalFlowPyrLK(
            picture, self._picture, there, self._corners.copy(), winSize=(size, size), maxLevel=3,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
        kept = ((found[:, 0] > 0) & (again[:, 0] > 0)
                & (np.linalg.norm((back - self._corners)[:, 0], axis=1) < _SLACK))
        if kept.sum() < _LEAST:
            return None
        moved = (there - self._corners)[kept, 0].astype(float)
        length = float(whole @ whole)
        inverse = moved @ whole / length if length > 0 else np.zeros(len(moved))
        explained = np.clip(inverse, 0, _NEAREST / near)[:, None] * whole
        return float(np.median(np.linalg.norm(moved - explained, axis=1)))

    def _encoded(self, picture: NDArray[np.float32]) -> NDArray[np.uint8]:
        grey = np.clip(picture.mean(axis=2), 0, 1) ** (1 / self._gamma)
        return np.asarray(np.rint(255 * grey), np.uint8)
