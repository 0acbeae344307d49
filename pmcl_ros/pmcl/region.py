"""The region of interest: a box in the camera's optical frame that holds the object's origin."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.render.scene import Window, sphere_bounds
from pmcl_ros.runtime.errors import LocalizationError


@dataclass(frozen=True)
class Region:
    """A box: center and size [m], camera's optical frame."""

    center: tuple[float, float, float]
    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not np.isfinite([*self.center, *self.size]).all() or min(self.size) <= 0:
            raise LocalizationError(f'region of interest at {self.center} m of size {self.size} '
                                    'm: every number must be finite and every size positive')
        if self.near <= 0.02:
            raise LocalizationError(f'region of interest begins at {self.near:.3f} m: it must lie '
                                    'in front of the camera (z forward)')

    @classmethod
    def before_camera(cls, camera: NDArray[np.float64], center: tuple[float, float, float],
                      size: tuple[float, float, float]) -> 'Region':
        """The box along the axes of a camera (4, 4) that holds a box of the camera's reference.

        camera: to that frame. Raises LocalizationError where it reaches behind the camera.
        """
        corners = np.array(list(itertools.product(*(
            (middle - side / 2, middle + side / 2)
            for middle, side in zip(center, size, strict=True)))))
        seen = (corners - camera[:3, 3]) @ camera[:3, :3]
        low, high = seen.min(axis=0), seen.max(axis=0)
        x, y, z = ((low + high) / 2).tolist()
        width, height, depth = (high - low).tolist()
        return cls((x, y, z), (width, height, depth))

    @property
    def near(self) -> float:
        """Smallest depth of the box [m]."""
        return self.center[2] - self.size[2] / 2

    @property
    def far(self) -> float:
        """Largest depth of the box [m]."""
        return self.center[2] + self.size[2] / 2

    def grown(self, radius: float) -> tuple[float, float]:
        """Depths (near, far) that hold an object of this radius whose origin is in the box [m]."""
        return max(self.near - radius, 0.2 * self.near), self.far + radius

    def depths(self, step: float) -> NDArray[np.float64]:
        """Depths over the box, a factor of about 1 + step apart, [m]."""
        count = max(1, math.ceil(math.log(self.far / self.near) / math.log1p(step)))
        edges = np.geomspace(self.near, self.far, count + 1)
        return np.sqrt(edges[1:] * edges[:-1])

    def footprint(self, pinhole: Pinhole, depth: float) -> tuple[float, float, float, float]:
        """Left, top, right, bottom pixel of the box at a depth, not cut at the image's border."""
        x, y, _ = np.array(self.center)
        half_x, half_y = self.size[0] / 2, self.size[1] / 2
        corners = pinhole.project(np.array([[x - half_x, y - half_y, depth],
                                            [x + half_x, y + half_y, depth]]))
        return corners[0, 0], corners[0, 1], corners[1, 0], corners[1, 1]

    def window(self, pinhole: Pinhole, radius: float) -> Window:
        """The part of the image that an object of this radius, its origin in the box, can cover.

        Raises LocalizationError when that is outside the image.
        """
        ends = [(middle - side / 2, middle + side / 2)
                for middle, side in zip(self.center, self.size, strict=True)]
        bounds = sphere_bounds(pinhole, np.array(list(itertools.product(*ends))), radius)
        left, top = np.clip(np.floor(bounds[:, :2].min(axis=0)), 0, None)
        right, bottom = np.clip(np.ceil(bounds[:, 2:].max(axis=0)) + 1, None,
                                (pinhole.width, pinhole.height))
        if left >= right or top >= bottom:
            raise self.out_of_view(pinhole)
        return Window(int(left), int(top), (int(right - left), int(bottom - top)))

    def check_depths(self, depths: NDArray[np.float64]) -> None:
        """Raise LocalizationError unless labels (far to near) reach into the region [m]."""
        far, near = depths[0], depths[-1]
        if far <= self.near or near >= self.far:
            raise LocalizationError(
                f'the depth labels span {near:.3f} to {far:.3f} m, the region of interest '
                f'{self.near:.3f} to {self.far:.3f} m; set near and far around the region')

    def out_of_view(self, pinhole: Pinhole) -> LocalizationError:
        """The error for a box in which the object cannot be seen anywhere."""
        return LocalizationError(
            f'the region of interest at {self.center} m of size {self.size} m is outside the '
            f'image ({pinhole.width}x{pinhole.height}); it is in the optical frame of the camera: '
            'x right, y down, z forward')

    @property
    def low(self) -> NDArray[np.float64]:
        """(3,) its least corner [m]."""
        return np.array(self.center) - np.array(self.size) / 2

    @property
    def high(self) -> NDArray[np.float64]:
        """(3,) its greatest corner [m]."""
        return np.array(self.center) + np.array(self.size) / 2

    def contains(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(n,) which points (n, 3) lie in the box."""
        reach = np.array(self.size) / 2 + 1e-9
        return (np.abs(points - np.array(self.center)) <= reach).all(axis=-1)

    def clip(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Points (n, 3), those outside the box moved onto its surface."""
        return np.clip(points, self.low, self.high)
