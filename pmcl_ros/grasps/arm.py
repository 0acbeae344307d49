"""Where the arm was when the shutter opened."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pose_buffer import PoseHistory, between
from pmcl_ros.runtime.errors import GraspError


class ArmHistory(PoseHistory):
    """The last poses of a link of the arm, as they were told.

    A capture's pose comes seconds after its shutter: what counts is where the arm was then.
    tolerance: how far from a told pose an asked stamp may lie [s]. kept: how long poses are
    remembered [s].
    """

    def __init__(self, tolerance: float, kept: float = 120.0) -> None:
        super().__init__(kept)
        self._tolerance_ns = round(tolerance * 1e9)

    def at(self, stamp_ns: int) -> NDArray[np.float64]:
        """(4, 4) the pose at a stamp, between the two about it, or the nearest.

        Raises GraspError when no pose lies within the tolerance.
        """
        stamps, poses = self.stamps, self.poses
        if not stamps:
            raise GraspError(f'no pose of the arm has come; the capture is of {stamp_ns}: publish '
                             'arm_pose, or set the parameter arm')
        after = self.place(stamp_ns)
        about = [each for each in (after - 1, after) if 0 <= each < len(stamps)]
        nearest = min(about, key=lambda each: abs(stamps[each] - stamp_ns))
        apart = stamps[nearest] - stamp_ns
        if abs(apart) > self._tolerance_ns:
            raise GraspError(
                f"the arm's pose that is nearest to the capture at {stamp_ns} is "
                f'{abs(apart) / 1e9:.3f} s {"newer" if apart > 0 else "older"}, at most '
                f'{self._tolerance_ns / 1e9:g} s are allowed (max_age): publish it around the '
                "shutter's time, with the same clock")
        ends = [stamps[each] - stamp_ns for each in about]
        if max(map(abs, ends)) > self._tolerance_ns or len(about) < 2:
            return poses[nearest]
        first, last = about
        return between(poses[first], poses[last], -ends[0] / (ends[1] - ends[0]))
