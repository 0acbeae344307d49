"""A tree of frames over time, as /tf has it."""

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pose_buffer import MovingPose, PoseBuffer
from pmcl_ros.runtime.errors import PoseUnavailableError

SPEED_INTERVAL = 0.05  # s: the speed is the mean of this time before a capture


class TransformTree:
    """The poses (4, 4) of frames in their parents [m]."""

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}
        self._fixed: dict[str, NDArray[np.float64]] = {}
        self._moving: dict[str, PoseBuffer] = {}

    def add(self, parent: str, child: str, pose: NDArray[np.float64],
            stamp_ns: int | None = None) -> None:
        """Store the pose (4, 4) of a frame in its parent [m] at a stamp; None: at any time.

        Raises PoseUnavailableError where the frame has had another parent.
        """
        if self._parents.setdefault(child, parent) != parent:
            raise PoseUnavailableError(f'{child!r} is in {self._parents[child]!r}, then in '
                                       f'{parent!r}: a frame has one parent')
        if stamp_ns is None:
            self._fixed[child] = pose
        else:
            self._moving.setdefault(child, PoseBuffer(None)).add(stamp_ns, pose)

    def interpolated(self, stamp_ns: int, frame: str, child: str, gap: float
                     ) -> MovingPose | None:
        """The pose of `child` in `frame` at a stamp, with the mean speed just before it.

        Where the poses begin, the speed is that just after it, or 0 where nothing tells it.
        gap [s], and None for what has not come yet: as of `PoseBuffer.interpolated`. Raises
        PoseUnavailableError as that does, and where no chain joins the frames.
        """
        now = self._at(stamp_ns, frame, child, gap)
        if now is None:
            return None
        interval, other = round(SPEED_INTERVAL * 1e9), None
        try:
            other = self._at(stamp_ns - interval, frame, child, gap)
        except PoseUnavailableError:
            with suppress(PoseUnavailableError):
                other = self._at(stamp_ns + interval, frame, child, gap)
        return (MovingPose(now) if other is None
                else MovingPose.between(other, now, SPEED_INTERVAL, 1))

    def _at(self, stamp_ns: int, frame: str, child: str, gap: float
            ) -> NDArray[np.float64] | None:
        ours, theirs = self._ancestors(frame), self._ancestors(child)
        shared = next((each for each in ours if each in theirs), None)
        if shared is None:
            raise PoseUnavailableError(
                f'no chain of transforms joins {child!r} to {frame!r}: there are '
                f'{", ".join(sorted({*self._parents, *self._parents.values()})[:20]) or "none"}; '
                'name the frames by fixed_frame, and camera_frame or mount_parent (--collect)')
        poses = []
        for chain in (ours, theirs):
            pose = np.eye(4)
            for each in chain[:chain.index(shared)]:
                step = self._step(each, stamp_ns, gap)
                if step is None:
                    return None
                pose = step @ pose
            poses.append(pose)
        return np.asarray(np.linalg.inv(poses[0]) @ poses[1])

    def _ancestors(self, frame: str) -> list[str]:
        """A frame, its parent, and so on."""
        chain = [frame]
        while chain[-1] in self._parents:
            if self._parents[chain[-1]] in chain:
                raise PoseUnavailableError(f'{frame!r} is its own ancestor')
            chain.append(self._parents[chain[-1]])
        return chain

    def _step(self, child: str, stamp_ns: int, gap: float) -> NDArray[np.float64] | None:
        if child in self._fixed:
            return self._fixed[child]
        moving = self._moving[child].interpolated(stamp_ns, gap)
        return None if moving is None else moving.pose
