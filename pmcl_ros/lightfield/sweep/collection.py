"""Collects the frames of a running sweep: the good ones, one for each place."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.sweep.assemble import Sweep, assemble
from pmcl_ros.lightfield.sweep.frame import LeftOut, SweepFrame
from pmcl_ros.lightfield.sweep.selection import Layout, distance, moves, relative_sharpness
from pmcl_ros.lightfield.sweep.settings import SweepSettings
from pmcl_ros.runtime.errors import LightFieldError

_APART = 0.25  # view steps: of two frames that are nearer only the sharper one is kept
MOST_BYTES = 2 ** 30  # of the images of all frames
_REMEMBERED = 1000  # frames that were left out: a camera at rest gives them day and night


class Frames:
    """Frames that are kept, and the last of those left out; left_out_count: how many are."""

    def __init__(self) -> None:
        self.frames: list[SweepFrame] = []
        self.left_out: deque[LeftOut] = deque(maxlen=_REMEMBERED)
        self.left_out_count = 0

    def leave_out(self, name: str, reason: str, spare: bool = False, moved: bool = False) -> None:
        """Record a dropped frame: see `LeftOut`."""
        self.left_out.append(LeftOut(name, reason, spare, moved))
        self.left_out_count += 1


class Collection(Frames):
    """Frames as they come. middle: (4, 4) of the planned grid, or None: see `assemble`."""

    def __init__(self, settings: SweepSettings, middle: NDArray[np.float64] | None = None) -> None:
        super().__init__()
        self._settings, self._middle = settings, middle

    def add(self, frame: SweepFrame) -> bool:
        """Add a frame; returns whether it is kept. Dropped frames go to `left_out`.

        Raises LightFieldError when the memory is full.
        """
        reason = moves(frame, self._settings)
        if reason:
            self.leave_out(frame.name, reason)
            return False
        for number, other in enumerate(self.frames):
            apart = distance(frame, other, self._settings.near)
            if apart < _APART * self._settings.baseline:
                old, new = relative_sharpness([other, frame])
                worse, better = (other, frame) if new > old else (frame, other)
                self.leave_out(worse.name, f'{better.name} is sharper, {1e3 * apart:.1f} mm '
                               'beside it', True)
                self.frames[number] = better
                return better is frame
        size = sum(each.image.nbytes for each in (*self.frames, frame))
        if size > MOST_BYTES:
            self.leave_out(frame.name, 'no room')
            raise LightFieldError(
                f'{frame.name} is given up: {len(self.frames)} frames, '
                f'{size / 2 ** 30:.1f} GiB, are kept already, {self.filled} of {self.cells} views '
                'are there; finish the sweep, move over a smaller area, or set a larger baseline')
        self.frames.append(frame)
        return True

    @property
    def cells(self) -> int:
        """Number of cells of the grid."""
        return self._settings.rows * self._settings.columns

    @property
    def filled(self) -> int:
        """Number of cells of the grid with a frame."""
        if not self.frames:
            return 0
        poses = [each.pose for each in self.frames]
        return Layout.from_poses(poses, self._settings, self._middle).filled

    @property
    def complete(self) -> bool:
        """Whether every cell has a frame."""
        return self.filled == self.cells

    @property
    def due(self) -> bool:
        """Whether it is to be published before it is complete: never."""
        return False

    def assemble(self, frame_id: str) -> Sweep:
        """The light field of the frames so far, which stay. Errors as of `assemble`."""
        return assemble(self.frames, self._settings, frame_id, self._middle, self.left_out)
