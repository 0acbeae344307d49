"""Frames as parallel views of one camera, and whether their pictures agree with their poses."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.sweep.frame import SweepFrame
from pmcl_ros.lightfield.sweep.settings import SweepSettings

_CORNERS = 400  # that are tracked at most
_LEAST = 20  # that must agree; fewer tell nothing
_STARTS = 4  # depths from which a corner is looked for, even in disparity
_SLACK = 1.0  # px: by which a track may come back beside its start
_NOISE = 0.5  # px: standard deviation of a good track
_FLAGS = cv2.OPTFLOW_USE_INITIAL_FLOW
_WINDOW, _LEVELS = (15, 15), 2


@dataclass(frozen=True)
class Rectification:
    """Where a frame shows each pixel of the view that it becomes.

    x, y: (height, width) float32 column and row in the frame [px]. offset: (3,) the frame's
    camera in the reference's optical frame [m].
    """

    x: NDArray[np.float32]
    y: NDArray[np.float32]
    offset: NDArray[np.float64]

    @classmethod
    def of(cls, frame: SweepFrame, reference: SweepFrame, settings: SweepSettings
           ) -> 'Rectification':
        """To a camera as the reference's without distortion, parallel to it.

        A pure turn is exact at all depths: the homography at infinity K R K^-1. A camera that is
        `offset[2]` = c ahead of the plane sees a point of depth z as much larger as z / (z - c);
        its view is made smaller by that of the depth `settings.focus`, f: right there, elsewhere
        its distances from the principal point are wrong by c (1 / z - 1 / f) of themselves.
        """
        turn = reference.pose[:3, :3].T @ frame.pose[:3, :3]
        offset = (frame.position - reference.position) @ reference.pose[:3, :3]
        camera = reference.lens.pinhole
        smaller = max((settings.focus - offset[2]) / settings.focus, 0.1)
        wanted = Pinhole(camera.width, camera.height, camera.fx * smaller, camera.fy * smaller,
                         camera.cx, camera.cy)
        x, y = frame.lens.places(turn, wanted)
        # Places known to a thousandth of a pixel: a reference without distortion stays as it is.
        return cls(np.round(x, 3), np.round(y, 3), offset)

    def error(self, pinhole: Pinhole, settings: SweepSettings) -> float:
        """Largest error in a corner at `near` or `far`, from being off the plane [px]."""
        corner = np.hypot(max(pinhole.cx, pinhole.width - 1 - pinhole.cx),
                          max(pinhole.cy, pinhole.height - 1 - pinhole.cy))
        return float(abs(self.offset[2]) * corner * (1 / settings.near - 1 / settings.focus))

    def inside(self, frame: SweepFrame) -> NDArray[np.bool_]:
        """(height, width) whether the frame shows the pixel."""
        pinhole = frame.lens.pinhole
        return np.asarray((self.x >= 0) & (self.x <= pinhole.width - 1)
                          & (self.y >= 0) & (self.y <= pinhole.height - 1))

    def picture(self, linear: NDArray[np.float32], window: tuple[slice, slice]
                ) -> NDArray[np.float32]:
        """The rows and columns `window` of the view, of a frame's light (height, width, 3)."""
        # Cubic: bilinear blurs, and would blur a view the more, the farther it is off whole
        # pixels. OpenCV knows 32 places in a pixel: they are off by 1/64 px at most.
        view = cv2.remap(linear, np.ascontiguousarray(self.x[window]),
                         np.ascontiguousarray(self.y[window]), cv2.INTER_CUBIC,
                         borderMode=cv2.BORDER_REPLICATE)
        return np.maximum(np.asarray(view, np.float32), np.float32(0))


def largest_window(seen: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of a rectangle all of which is seen, (height, width) bool.

    Sides are taken in one after the other, always that of which most is unseen. May be empty.
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


def linear_light(image: NDArray[Any], gamma: float) -> NDArray[np.float32]:
    """Values uint8, uint16 or float32, encoded by 1 / gamma, as linear light, 1 at white."""
    if image.dtype == np.float32:
        return np.maximum(image, np.float32(0)) ** np.float32(gamma)
    white = np.iinfo(image.dtype).max
    table = ((np.arange(white + 1) / white) ** gamma).astype(np.float32)
    return np.asarray(table[image])


class Tracker:
    """Corners of the reference view, looked for in the others."""

    def __init__(self, reference: NDArray[np.float32], gamma: float) -> None:
        self._gamma = gamma
        self._picture = self._encoded(reference)
        found = cv2.goodFeaturesToTrack(self._picture, _CORNERS, 0.005, 5)
        self._corners = np.empty((0, 1, 2), np.float32) if found is None else found

    def residual(self, view: NDArray[np.float32], offset: NDArray[np.float64], pinhole: Pinhole,
                 near: float) -> float | None:
        """How far from where its pose allows them most tracked corners are [px].

        view: (height, width, 3) linear, rectified, of a camera at `offset` (3,) [m] in the
        reference's frame. A point of any depth is displaced along -f (x, y); what is across that
        is the pose's fault, or that of a track gone wrong. Wrong tracks lie anywhere, right ones
        together: the place where most lie counts. near: depth of what is nearest [m]. None where
        too few lie together.
        """
        whole = -offset[:2] * [pinhole.fx, pinhole.fy]  # px, times the inverse depth
        moved = self._moved(self._encoded(view), whole, near)
        length = float(np.linalg.norm(whole))
        if length / near < 2 * _NOISE:  # nothing is displaced, whatever its depth
            return _densest(moved)
        return _densest(moved @ np.array([[-whole[1]], [whole[0]]]) / length)

    def _moved(self, picture: NDArray[np.uint8], whole: NDArray[np.float64], near: float
               ) -> NDArray[np.float64]:
        """(n, 2) displacements [px] of the corners that were found again."""
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
    """Distance from 0 of where most of values (n, k) lie; None where that are few."""
    if len(values) < _LEAST:
        return None
    squares = ((values[:, None] - values) ** 2).sum(axis=-1) / _NOISE ** 2
    middle = int(np.argmax(np.exp(-squares / 2).sum(axis=1)))
    together = values[squares[middle] < 9]
    if len(together) < _LEAST:
        return None
    return float(np.linalg.norm(np.median(together, axis=0)))
