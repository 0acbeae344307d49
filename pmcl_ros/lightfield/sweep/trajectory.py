"""Where the camera was when a picture was taken."""

import bisect
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from pmcl_ros.errors import LightFieldError


@dataclass(frozen=True)
class Moving:
    """A pose (4, 4) [m], and how fast it changes [m/s], [rad/s]."""

    pose: NDArray[np.float64]
    speed: float = 0.0
    turning: float = 0.0


class Trajectory:
    """Poses as they were told, and between them.

    gap: the longest time between two poses that are interpolated [s]. kept: how long poses are
    remembered [s].
    """

    def __init__(self, gap: float, kept: float = 120.0) -> None:
        self._gap_ns, self._kept_ns = round(gap * 1e9), round(kept * 1e9)
        self._stamps: list[int] = []
        self._poses: list[NDArray[np.float64]] = []

    def add(self, stamp_ns: int, pose: NDArray[np.float64]) -> None:
        """Remember a pose; a stamp from far back (the clock was set) drops the others."""
        if self._stamps and stamp_ns < self._stamps[-1] - self._kept_ns:
            self._stamps, self._poses = [], []
        place = bisect.bisect_left(self._stamps, stamp_ns)
        if place < len(self._stamps) and self._stamps[place] == stamp_ns:
            self._poses[place] = pose
            return
        self._stamps.insert(place, stamp_ns)
        self._poses.insert(place, pose)
        old = bisect.bisect_left(self._stamps, self._stamps[-1] - self._kept_ns)
        del self._stamps[:old], self._poses[:old]

    def at(self, stamp_ns: int) -> Moving | None:
        """The pose at a stamp: one of that very stamp, or between the two about it.

        None: a pose of that time may still come. Raises LightFieldError when none will: the two
        about it are too far apart, or the first is younger.
        """
        after = bisect.bisect_left(self._stamps, stamp_ns)
        if after == len(self._stamps):
            return None
        if self._stamps[after] == stamp_ns:
            return self._told(after)
        if after == 0:
            raise LightFieldError(f'poses begin {(self._stamps[0] - stamp_ns) / 1e9:.3f} s after '
                                  'it')
        first, last = self._stamps[after - 1:after + 1]
        if last - first > self._gap_ns:
            raise LightFieldError(f'the poses about it are {(last - first) / 1e9:.3f} s apart, at '
                                  f'most {self._gap_ns / 1e9:g} s are allowed (gap)')
        return between(self._poses[after - 1], self._poses[after], (last - first) / 1e9,
                       (stamp_ns - first) / (last - first))

    def _told(self, place: int) -> Moving:
        """A pose as it is, moving as it does from the one before or to the one after it."""
        fastest = Moving(self._poses[place])
        for a in (place - 1, place):
            if a < 0 or a + 1 >= len(self._stamps):
                continue
            apart = self._stamps[a + 1] - self._stamps[a]
            if apart <= self._gap_ns:
                moving = between(self._poses[a], self._poses[a + 1], apart / 1e9, 0)
                fastest = Moving(fastest.pose, max(fastest.speed, moving.speed),
                                 max(fastest.turning, moving.turning))
        return fastest


def between(first: NDArray[np.float64], last: NDArray[np.float64], seconds: float, part: float
            ) -> Moving:
    """At `part` (0 to 1) of the way, straight and at an even rate, between poses (4, 4)."""
    turns = Rotation.from_matrix([first[:3, :3], last[:3, :3]])
    pose = np.eye(4)
    pose[:3, 3] = (1 - part) * first[:3, 3] + part * last[:3, 3]
    pose[:3, :3] = Slerp([0.0, 1.0], turns)(part).as_matrix()
    way = float(np.linalg.norm(last[:3, 3] - first[:3, 3]))
    angle = float((turns[0].inv() * turns[1]).magnitude())
    return Moving(pose, way / seconds, angle / seconds)
