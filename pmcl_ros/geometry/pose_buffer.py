"""Poses as they were told over time, of an arm or of a moved camera."""

import bisect

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp


class PoseHistory:
    """The last poses, by their times.

    stamps: [ns], in order; poses: (4, 4) each. kept: how long they are remembered [s].
    """

    def __init__(self, kept: float) -> None:
        self._kept_ns = round(kept * 1e9)
        self.stamps: list[int] = []
        self.poses: list[NDArray[np.float64]] = []

    def add(self, stamp_ns: int, pose: NDArray[np.float64]) -> None:
        """Remember a pose (4, 4); a stamp from far back (the clock was set) drops the others."""
        if self.stamps and stamp_ns < self.stamps[-1] - self._kept_ns:
            self.stamps, self.poses = [], []
        place = self.place(stamp_ns)
        if place < len(self.stamps) and self.stamps[place] == stamp_ns:
            self.poses[place] = pose
            return
        self.stamps.insert(place, stamp_ns)
        self.poses.insert(place, pose)
        old = self.place(self.stamps[-1] - self._kept_ns)
        del self.stamps[:old], self.poses[:old]

    def place(self, stamp_ns: int) -> int:
        """Of the first pose that is not older."""
        return bisect.bisect_left(self.stamps, stamp_ns)


def between(first: NDArray[np.float64], last: NDArray[np.float64], part: float
            ) -> NDArray[np.float64]:
    """(4, 4) at `part` (0 to 1) of the way between two poses, straight and at an even rate."""
    pose = np.eye(4)
    pose[:3, 3] = (1 - part) * first[:3, 3] + part * last[:3, 3]
    turns = Rotation.from_matrix([first[:3, :3], last[:3, :3]])
    pose[:3, :3] = Slerp([0.0, 1.0], turns)(part).as_matrix()
    return pose
