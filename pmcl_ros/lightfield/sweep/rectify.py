"""Frames as parallel views of one camera, and whether their pictures agree with their poses."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.sweep.frame import SweepFrame
from pmcl_ros.lightfield.sweep.settings import SweepSettings

_CORNERS = 400  # tracked at most
_LEAST = 20  # that must agree
_STARTS = 4  # start depths of a search, uniform in disparity
_SLACK = 1.0  # px: tolerance of the forward-backward check
_NOISE = 0.5  # px: standard deviation of a good track
_FLAGS = cv2.OPTFLOW_USE_INITIAL_FLOW
_WINDOW, _LEVELS = (15, 15), 2  # px; pyramid levels: of tracks that start near their end


@dataclass(frozen=True)
class Rectification:
    """Map from the pixels of a rectified view to its frame.

    x, y: (height, width) float32 column and row in the frame [px]. offset: (3,) position of the
    frame's camera in the reference's optical frame [m].
    """

    x: NDArray[np.float32]
    y: NDArray[np.float32]
    offset: NDArray[np.float64]

    @classmethod
    def from_frames(cls, frame: SweepFrame, reference: SweepFrame, settings: SweepSettings
           ) -> 'Rectification':
        """Rectify to a camera like the reference's, without distortion and parallel to it.

        A pure rotation is exact at all depths: the homography at infinity K R K^-1. A camera at
        `offset[2]` = c ahead of the plane magnifies points of depth z by z / (z - c). The view is
        scaled to be exact at the depth f = `settings.focus`; elsewhere distances from the
        principal point have the relative error c (1 / z - 1 / f).
        """
        turn = reference.pose[:3, :3].T @ frame.pose[:3, :3]
        offset = (frame.position - reference.position) @ reference.pose[:3, :3]
        camera = reference.lens.pinhole
        smaller = max((settings.focus - offset[2]) / settings.focus, 0.1)
        wanted = Pinhole(camera.width, camera.height, camera.fx * smaller, camera.fy * smaller,
                         camera.cx, camera.cy)
        x, y = frame.lens.places(turn, wanted)
        # Rounded to 0.001 px: a reference without distortion stays unchanged.
        return cls(np.round(x, 3), np.round(y, 3), offset)

    def error(self, pinhole: Pinhole, settings: SweepSettings) -> float:
        """Largest error in a corner at `near` or `far` by the distance to the plane [px]."""
        corner = np.hypot(max(pinhole.cx, pinhole.width - 1 - pinhole.cx),
                          max(pinhole.cy, pinhole.height - 1 - pinhole.cy))
        return float(abs(self.offset[2]) * corner * (1 / settings.near - 1 / settings.focus))

    def inside(self, frame: SweepFrame) -> NDArray[np.bool_]:
        """(height, width) whether a pixel lies in the frame."""
        pinhole = frame.lens.pinhole
        return np.asarray((self.x >= 0) & (self.x <= pinhole.width - 1)
                          & (self.y >= 0) & (self.y <= pinhole.height - 1))

    def picture(self, linear: NDArray[np.float32], window: tuple[slice, slice]
                ) -> NDArray[np.float32]:
        """The `window` (rows, columns) of the view, from the frame's light (height, width, 3)."""
        # Cubic, since bilinear blur depends on the sub-pixel shift. OpenCV rounds to 1/32 px.
        view = cv2.remap(linear, np.ascontiguousarray(self.x[window]),
                         np.ascontiguousarray(self.y[window]), cv2.INTER_CUBIC,
                         borderMode=cv2.BORDER_REPLICATE)
        return np.maximum(np.asarray(view, np.float32), np.float32(0))


def largest_window(seen: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of a rectangle in which all of `seen` (height, width) is True.

    Greedy: the side with most unseen pixels moves inwards first. The rectangle may be empty.
    """
    top, left = 0, 0
    bottom, right = seen.shape
    while top < bottom and left < right:
        inner = seen[top:bottom, left:right]
        unseen = [1 - each.mean() for each in (inner[0], inner[-1], inner[:, 0], inner[:, -1])]
        worst = int(np.argmax(unseen))
        if unseen[worst] == 0 and inner.all():
            break
        top, bottom = top + (worst == 0), bottom - (worst == 1)
        left, right = left + (worst == 2), right - (worst == 3)
    return slice(top, bottom), slice(left, right)



class CornerTracker:
    """Tracks corners of the reference view in the other views."""

    def __init__(self, reference: NDArray[np.float32], gamma: float) -> None:
        self._gamma = gamma
        self._picture = self._encoded(reference)
        found = cv2.goodFeaturesToTrack(self._picture, _CORNERS, 0.005, 5)
        self._corners = np.empty((0, 1, 2), np.float32) if found is None else found

    def residual(self, view: NDArray[np.float32], offset: NDArray[np.float64], pinhole: Pinhole,
                 near: float) -> float | None:
        """Distance of the tracked corners from the epipolar lines of the pose [px].

        view: (height, width, 3) linear, rectified, of a camera at `offset` (3,) [m] in the
        reference's frame. Points of any depth are displaced along -f (x, y); the displacement
        across is an error of the pose or of a track. Wrong tracks scatter, correct ones agree:
        the mode of the displacements counts. near: smallest depth [m]. None: too few agree.
        """
        whole = -offset[:2] * [pinhole.fx, pinhole.fy]  # px, times the inverse depth
        moved = self._moved(self._encoded(view), whole, near)
        length = float(np.linalg.norm(whole))
        if length / near < 2 * _NOISE:  # no displacement at any depth
            return _densest(moved)
        return _densest(moved @ np.array([[-whole[1]], [whole[0]]]) / length)

    def _moved(self, picture: NDArray[np.uint8], whole: NDArray[np.float64], near: float
               ) -> NDArray[np.float64]:
        """(n, 2) displacements [px] of the tracked corners."""
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
    """Norm of the mode of values (n, k); None: too few agree."""
    if len(values) < _LEAST:
        return None
    squares = ((values[:, None] - values) ** 2).sum(axis=-1) / _NOISE ** 2
    middle = int(np.argmax(np.exp(-squares / 2).sum(axis=1)))
    together = values[squares[middle] < 9]
    if len(together) < _LEAST:
        return None
    return float(np.linalg.norm(np.median(together, axis=0)))
