"""A flat surface between air and a liquid, and where things below it appear to be."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import inverse

_STEPS = 60  # of bisection


@dataclass(frozen=True)
class Interface:
    """A plane; beyond it is a medium of another refractive index, without end.

    point: (3,) on it [m]. normal: (3,) unit vector into the air. index: of the medium over that
    of the air.
    """

    point: NDArray[np.float64]
    normal: NDArray[np.float64]
    index: float

    def seen_from(self, camera: NDArray[np.float64]) -> 'Interface':
        """In the frame of a camera, whose pose (4, 4) is in this one's frame."""
        into = inverse(camera)
        return Interface(into[:3, :3] @ self.point + into[:3, 3], into[:3, :3] @ self.normal,
                         self.index)

    @property
    def height(self) -> float:
        """Of the frame's origin above it [m]; negative: the origin is in the medium."""
        return float(-self.normal @ self.point)

    def apparent(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) where points (n, 3) [m] appear to be from the origin of the frame.

        A ray from the origin is bent by Snell's law where it meets the plane. A point in the
        medium appears straight above itself, on the line of the ray before it is bent. Points in
        the air stay, and all do where the origin is in the medium.
        """
        height = self.height
        depth = -height - points @ self.normal
        below = depth > 0
        if height <= 0 or not below.any():
            return points.copy()
        s, inside = depth[below], points[below]
        across = np.linalg.norm(inside - (inside @ self.normal)[:, None] * self.normal, axis=1)
        low, high = np.zeros_like(across), across.copy()
        for _ in range(_STEPS):  # for where the ray meets the plane: more to go below, less above
            meets = (low + high) / 2
            rest = across - meets
            short = (meets / np.hypot(meets, height)
                     < self.index * rest / np.maximum(np.hypot(rest, s), 1e-300))
            low, high = np.where(short, meets, low), np.where(short, high, meets)
        meets = (low + high) / 2
        seen = np.where(across > 1e-9, height * (across - meets) / np.maximum(meets, 1e-300),
                        s / self.index)
        result = points.copy()
        result[below] += (s - seen)[:, None] * self.normal
        return result
