"""What is drawn for a pose: one object, seen by one camera through one window."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.interface import Interface
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import RenderError


@dataclass(frozen=True)
class Window:
    """The part of the image that tiles show: `size` (width, height) of `scale` image pixels each.

    left, top: image pixel of the window's corner. Tile pixel X is at image pixel
    left + scale X + (scale - 1) / 2.
    """

    left: int
    top: int
    size: tuple[int, int]
    scale: int = 1

    def pinhole(self, image: Pinhole) -> Pinhole:
        """The camera of a tile."""
        shift = (self.scale - 1) / 2
        return Pinhole(*self.size, image.fx / self.scale, image.fy / self.scale,
                       (image.cx - self.left - shift) / self.scale,
                       (image.cy - self.top - shift) / self.scale)

    def coarser(self, scale: int) -> 'Window':
        """The same part of the image in tile pixels of `scale` image pixels."""
        width, height = (math.ceil(side * self.scale / scale) for side in self.size)
        return Window(self.left, self.top, (width, height), scale)


@dataclass(frozen=True, eq=False)
class Scene:
    """An object before a camera.

    model: its mesh. image: the whole image's camera. window: the part that is drawn. near, far:
        depths between which surfaces are drawn [m]; those of every pose should be.
    interface: of water between the camera and the object, in the camera's frame; only what the
        processor draws is drawn through it.
    Raises RenderError when the object could be at the camera.
    """

    model: ObjectModel
    image: Pinhole
    window: Window
    near: float
    far: float
    interface: Interface | None = None

    def __post_init__(self) -> None:
        if not 0 < self.near < self.far:
            raise RenderError(f'cannot render between {self.near:.3f} m and {self.far:.3f} m: the '
                              'object would be at the camera')

    @cached_property
    def camera(self) -> Pinhole:
        """Of the window."""
        return self.window.pinhole(self.image)


def sphere_bounds(camera: Pinhole, centres: NDArray[np.floating], radius: float
                  ) -> NDArray[np.float64]:
    """(n, 4) left, top, right, bottom pixel of spheres about (n, 3) [m]; infinite at the camera.

    That is where the planes through the camera and the image's axes touch a sphere: off the axis
    it is wider than the radius over the depth.
    """
    z = centres[:, 2]
    ahead = z > radius
    square = np.where(ahead, z ** 2 - radius ** 2, 1)
    low, high = [], []
    for side, focal, middle in ((centres[:, 0], camera.fx, camera.cx),
                                (centres[:, 1], camera.fy, camera.cy)):
        reach = radius * np.sqrt(np.where(ahead, side ** 2 + square, 0))
        low.append(np.where(ahead, focal * (side * z - reach) / square + middle, -np.inf))
        high.append(np.where(ahead, focal * (side * z + reach) / square + middle, np.inf))
    return np.stack(low + high, axis=-1)
