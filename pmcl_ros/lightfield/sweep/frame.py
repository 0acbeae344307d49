"""One picture of a sweep, and where it was taken."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.sweep.lens import Lens
from pmcl_ros.runtime.errors import LightFieldError

_SIGMA = 1.0  # px: the noise of pixels, which no movement blurs, is smoothed away
_RIGID = 1e-4  # how far from orthogonal a rotation may be: messages come rounded


class LeftOut(NamedTuple):
    """A frame that was not used, and why. spare: only since a better one of its place is there."""

    name: str
    reason: str
    spare: bool = False

    def __str__(self) -> str:
        return f'{self.name}: {self.reason}'


@dataclass(frozen=True)
class SweepFrame:
    """A picture, its camera and its pose.

    name: by which it is told. stamp_ns: of its exposure. image: (height, width, 3) RGB as the
    camera gave it: uint8, uint16, or float32 with 1 at white. pose: (4, 4) the optical frame (x
    right, y down, z forward) in a frame that stands still [m]. speed, turning: of the camera
    while it was exposed [m/s], [rad/s].
    Raises LightFieldError when these do not fit together.
    """

    name: str
    stamp_ns: int
    image: NDArray[Any]
    lens: Lens
    pose: NDArray[np.float64]
    speed: float = 0.0
    turning: float = 0.0

    def __post_init__(self) -> None:
        pinhole = self.lens.pinhole
        if (self.image.shape != (pinhole.height, pinhole.width, 3)
                or self.image.dtype not in (np.uint8, np.uint16, np.float32)):
            raise LightFieldError(
                f'{self.name} is {self.image.dtype} of shape {self.image.shape}, its camera has '
                f'{pinhole.width}x{pinhole.height} px; expected (height, width, 3) of uint8, '
                'uint16 or float32')
        turn = self.pose[:3, :3]
        if (self.pose.shape != (4, 4) or not np.isfinite(self.pose).all()
                or abs(turn @ turn.T - np.eye(3)).max() > _RIGID or np.linalg.det(turn) < 0):
            raise LightFieldError(f'{self.name}: its pose {self.pose.tolist()} is no rigid '
                                  'transform (4, 4)')

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,) of the camera [m]."""
        return self.pose[:3, 3]

    def movement(self, near: float, exposure: float) -> float:
        """How far something at depth `near` moves in the picture in `exposure` s [px]."""
        return self.lens.pinhole.fx * exposure * (self.speed / near + self.turning)

    @cached_property
    def brightness(self) -> float:
        """The mean of the values as the camera gave them, 1 at white."""
        return float(self._grey.mean())

    @cached_property
    def sharpness(self) -> NDArray[np.float64]:
        """(2,) energy of the second derivatives across and down, relative to the brightness.

        Of two directions, as movement blurs along its own alone.
        """
        smooth = cv2.GaussianBlur(self._grey, (0, 0), _SIGMA)
        bends = (cv2.Sobel(smooth, cv2.CV_32F, 2, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 2))
        return np.array([float((each ** 2).mean()) for each in bends]) / max(
            self.brightness, 1e-6) ** 2

    @cached_property
    def _grey(self) -> NDArray[np.float32]:
        white = 1.0 if self.image.dtype == np.float32 else np.iinfo(self.image.dtype).max
        return np.asarray(self.image.mean(axis=2, dtype=np.float32) / np.float32(white))
