"""Where the arm was when the shutter opened."""

import bisect

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from pmcl_ros.errors import GraspError


class ArmHistory:
    """The last poses of a link of the arm, as they were told.

    A capture's pose comes seconds after its shutter: what counts is where the arm was then.
    tolerance: how far from a told pose an asked stamp may lie [s]. kept: how long poses are
    remembered [s].
    """

    def __init__(self, tolerance: float, kept: float = 120.0) -> None:
        self._tolerance_ns, self._kept_ns = round(tolerance * 1e9), round(kept * 1e9)
        self._stamps: list[int] = []
        self._poses: list[NDArray[np.float64]] = []

    def add(self, stamp_ns: int, pose: NDArray[np.float64]) -> None:
        """Remember a pose (4, 4); a stamp from far back (the clock was set) drops the others."""
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

    def at(self, stamp_ns: int) -> NDArray[np.float64]:
        """(4, 4) the pose at a stamp, between the two about it, or the nearest.

        Raises GraspError when no pose lies within the tolerance.
        """
        if not self._stamps:
            raise GraspError(f'no pose of the arm has come; the capture is of {stamp_ns}: publish '
                             'arm_pose, or set the parameter arm')
        after = bisect.bisect_left(self._stamps, stamp_ns)
        about = [each for each in (after - 1, after) if 0 <= each < len(self._stamps)]
        nearest = min(about, key=lambda each: abs(self._stamps[each] - stamp_ns))
        apart = self._stamps[nearest] - stamp_ns
        if abs(apart) > self._tolerance_ns:
            raise GraspError(
                f"the arm's pose that is nearest to the capture at {stamp_ns} is "
                f'{abs(apart) / 1e9:.3f} s {"newer" if apart > 0 else "older"}, at most '
                f'{self._tolerance_ns / 1e9:g} s are allowed (max_age): publish it around the '
                "shutter's time, with the same clock")
        ends = [self._stamps[each] - stamp_ns for each in about]
        if max(map(abs, ends)) > self._tolerance_ns or len(about) < 2:
            return self._poses[nearest]
        part = -ends[0] / (ends[1] - ends[0])
        first, last = (self._poses[each] for each in about)
        pose = np.eye(4)
        pose[:3, 3] = (1 - part) * first[:3, 3] + part * last[:3, 3]
        turns = Rotation.from_matrix([first[:3, :3], last[:3, :3]])
        pose[:3, :3] = Slerp([0.0, 1.0], turns)(part).as_matrix()
        return pose
