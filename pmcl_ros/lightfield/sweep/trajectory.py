"""Where the camera was when a picture was taken."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pose_buffer import PoseHistory, between
from pmcl_ros.runtime.errors import LightFieldError


@dataclass(frozen=True)
class Moving:
    """A pose (4, 4) [m], and how fast it changes [m/s], [rad/s]."""

    pose: NDArray[np.float64]
    speed: float = 0.0
    turning: float = 0.0

    @classmethod
    def between(cls, first: NDArray[np.float64], last: NDArray[np.float64], seconds: float,
                part: float) -> 'Moving':
        """At `part` (0 to 1) of the way between poses (4, 4) that are `seconds` apart."""
        turn = Rotation.from_matrix(first[:3, :3].T @ last[:3, :3])
        way = float(np.linalg.norm(last[:3, 3] - first[:3, 3]))
        return cls(between(first, last, part), way / seconds, float(turn.magnitude()) / seconds)


class Trajectory(PoseHistory):
    """Poses as they were told, and between them.

    gap: the longest time between two poses that are interpolated [s]. kept: how long poses are
    remembered [s].
    """

    def __init__(self, gap: float, kept: float = 120.0) -> None:
        super().__init__(kept)
        self._gap_ns = round(gap * 1e9)

    def at(self, stamp_ns: int) -> Moving | None:
        """The pose at a stamp: one of that very stamp, or between the two about it.

        None: a pose of that time may still come. Raises LightFieldError when none will: the two
        about it are too far apart, or the first is younger.
        """
        stamps, poses = self.stamps, self.poses
        after = self.place(stamp_ns)
        if after == len(stamps):
            return None
        if stamps[after] == stamp_ns:
            return self._of(after)
        if after == 0:
            raise LightFieldError(f'poses begin {(stamps[0] - stamp_ns) / 1e9:.3f} s after it')
        first, last = stamps[after - 1:after + 1]
        if last - first > self._gap_ns:
            raise LightFieldError(f'the poses about it are {(last - first) / 1e9:.3f} s apart, at '
                                  f'most {self._gap_ns / 1e9:g} s are allowed (gap)')
        return Moving.between(poses[after - 1], poses[after], (last - first) / 1e9,
                              (stamp_ns - first) / (last - first))

    def _of(self, place: int) -> Moving:
        """A pose as it is, moving as it does from the one before or to the one after it."""
        stamps, poses = self.stamps, self.poses
        fastest = Moving(poses[place])
        for a in (place - 1, place):
            if a < 0 or a + 1 >= len(stamps):
                continue
            apart = stamps[a + 1] - stamps[a]
            if apart <= self._gap_ns:
                moving = Moving.between(poses[a], poses[a + 1], apart / 1e9, 0)
                fastest = Moving(fastest.pose, max(fastest.speed, moving.speed),
                                 max(fastest.turning, moving.turning))
        return fastest
