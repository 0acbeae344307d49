"""Time-stamped poses of an arm or a camera, and the pose at the time of a capture."""

import bisect
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import interpolate
from pmcl_ros.runtime.errors import PoseUnavailableError

_BACK = 5_000_000_000  # ns: no pose comes so late


@dataclass(frozen=True)
class MovingPose:
    """A pose (4, 4) [m], its speed [m/s] and its angular speed [rad/s]."""

    pose: NDArray[np.float64]
    speed: float = 0.0
    angular_speed: float = 0.0

    @classmethod
    def between(cls, first: NDArray[np.float64], last: NDArray[np.float64], seconds: float,
                fraction: float) -> 'MovingPose':
        """At `fraction` (0 to 1) between two poses (4, 4) that are `seconds` apart."""
        rotation = Rotation.from_matrix(first[:3, :3].T @ last[:3, :3])
        distance = float(np.linalg.norm(last[:3, 3] - first[:3, 3]))
        return cls(interpolate(first, last, fraction), distance / seconds,
                   float(rotation.magnitude()) / seconds)


class PoseBuffer:
    """The poses of the last seconds, sorted by time; they may be added in any order.

    A capture is processed seconds after its shutter, and asks for the pose of that moment: an arm
    asks for the `nearest` one, a sweep for an `interpolated` one.

    duration: poses that are older than the newest by more are forgotten [s]; None: none is.
    """

    def __init__(self, duration: float | None = 120.0) -> None:
        self._duration_ns = None if duration is None else round(duration * 1e9)
        self._stamps: list[int] = []  # sorted, ns
        self._poses: list[NDArray[np.float64]] = []

    def add(self, stamp_ns: int, pose: NDArray[np.float64]) -> None:
        """Store a pose (4, 4); one older than the newest by seconds clears all: the clock was set.
        """
        kept = self._duration_ns
        if kept is not None and self._stamps and stamp_ns < self._stamps[-1] - min(kept, _BACK):
            self._stamps, self._poses = [], []
        index = bisect.bisect_left(self._stamps, stamp_ns)
        if index < len(self._stamps) and self._stamps[index] == stamp_ns:
            self._poses[index] = pose
            return
        self._stamps.insert(index, stamp_ns)
        self._poses.insert(index, pose)
        if kept is not None:
            old = bisect.bisect_left(self._stamps, self._stamps[-1] - kept)
            del self._stamps[:old], self._poses[:old]

    @property
    def newest(self) -> int | None:
        """The stamp of the newest pose [ns]; None: there is none."""
        return self._stamps[-1] if self._stamps else None

    def nearest(self, stamp_ns: int, tolerance: float) -> NDArray[np.float64]:
        """(4, 4) pose at a stamp: interpolated between its neighbours, else the nearest one.

        Only poses within `tolerance` [s] of the stamp count; raises PoseUnavailableError when
        there is none.
        """
        stamps, poses = self._stamps, self._poses
        if not stamps:
            raise PoseUnavailableError(f'no pose has come; the capture is of {stamp_ns}')
        after = bisect.bisect_left(stamps, stamp_ns)
        neighbours = [each for each in (after - 1, after) if 0 <= each < len(stamps)]
        nearest = min(neighbours, key=lambda each: abs(stamps[each] - stamp_ns))
        offset = stamps[nearest] - stamp_ns
        if abs(offset) > round(tolerance * 1e9):
            raise PoseUnavailableError(
                f'the pose nearest to the capture at {stamp_ns} is {abs(offset) / 1e9:.3f} s '
                f'{"newer" if offset > 0 else "older"}, at most {tolerance:g} s are allowed')
        offsets = [stamps[each] - stamp_ns for each in neighbours]
        if max(map(abs, offsets)) > round(tolerance * 1e9) or len(neighbours) < 2:
            return poses[nearest]
        first, last = neighbours
        return interpolate(poses[first], poses[last], -offsets[0] / (offsets[1] - offsets[0]))

    def interpolated(self, stamp_ns: int, gap: float) -> MovingPose | None:
        """The pose at a stamp: one of that very stamp, or between the two neighbours.

        gap: the longest time between two poses that are interpolated [s].
        None: no newer pose has come yet. Raises PoseUnavailableError when none will help: the
        neighbours are too far apart, or all poses are newer.
        """
        if stamp_ns == 0:
            raise PoseUnavailableError('the capture has the stamp 0, which is no time: let the '
                                       'camera driver stamp its images')
        stamps, poses = self._stamps, self._poses
        after = bisect.bisect_left(stamps, stamp_ns)
        if after == len(stamps):
            return None
        if stamps[after] == stamp_ns:
            return self._with_speed(after, gap)
        if after == 0:
            raise PoseUnavailableError(f'the first pose is {(stamps[0] - stamp_ns) / 1e9:.3f} s '
                                       f'newer than the capture at {stamp_ns}')
        first, last = stamps[after - 1:after + 1]
        if last - first > round(gap * 1e9):
            raise PoseUnavailableError(f'the poses about the capture at {stamp_ns} are '
                                       f'{(last - first) / 1e9:.3f} s apart, at most {gap:g} s '
                                       'are allowed (gap)')
        return MovingPose.between(poses[after - 1], poses[after], (last - first) / 1e9,
                                  (stamp_ns - first) / (last - first))

    def _with_speed(self, index: int, gap: float) -> MovingPose:
        """A stored pose, with the larger of the speeds from the one before and to the next."""
        speed = angular_speed = 0.0
        for first in (index - 1, index):
            if first < 0 or first + 1 >= len(self._stamps):
                continue
            apart = self._stamps[first + 1] - self._stamps[first]
            if apart <= round(gap * 1e9):
                moving = MovingPose.between(self._poses[first], self._poses[first + 1],
                                            apart / 1e9, 0)
                speed = max(speed, moving.speed)
                angular_speed = max(angular_speed, moving.angular_speed)
        return MovingPose(self._poses[index], speed, angular_speed)
