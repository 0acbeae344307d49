"""Photographs of generated scenes by an ordinary camera, with the distortion of its lens."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, encoded
from pmcl_ros.lightfield.readers.posed_views import ViewCamera
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.simulation.scenes.render import Renderer, fast, seen_from
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.sensor import Sensor, exposure, noisy, one_view, sensed

_PUPIL = 4.0  # quarters of the aperture's width: none of it is cut off
_LARGEST = 25.0  # of the picture: the pinhole picture that its distortion needs
_MOST_PIXELS = 2 ** 26  # as of pictures that are read
_TRIES, _CLOSE = 500, 0.01  # steps of inverting a distortion, and the tolerance [px]


class OrdinaryCamera(ViewCamera):
    """camera.yaml: a camera as in views.yaml, its noise and its blur."""

    noise: float = Field(0.006, ge=0, le=1, description='standard deviation of linear green at '
                         'half of white [1]; it grows with the root of the light')
    blur: float = Field(0.6, ge=0, le=10, description='standard deviation of the blur [px]')

    @model_validator(mode='after')
    def _small(self) -> 'OrdinaryCamera':
        if self.width * self.height > _MOST_PIXELS:
            raise ValueError(f'pictures of {self.width}x{self.height} px are larger than '
                             f'{_MOST_PIXELS / 1e6:.0f} million pixels: say width and height of '
                             'a smaller camera')
        return self

    def sensor(self, rng: np.random.Generator) -> Sensor:
        """Its pixels, noise and blur; focus and exposure are random."""
        return Sensor(one_view(self.pinhole), float(rng.uniform(0.4, 0.8)), _PUPIL, self.blur,
                      float(rng.uniform(0.2, 0.42)), 2 * self.noise ** 2, self.noise / 3,
                      (1.0, 1.0, 1.0))

    @property
    def field(self) -> float:
        """The smaller side of a picture over the focal length."""
        return min(self.width / self.fx, self.height / (self.fy or self.fx))


@dataclass(frozen=True)
class _Distortion:
    """The pinhole picture that holds all that a lens sees, and where each pixel is in it.

    x, y: (height, width) float32 [px].
    """

    pinhole: Pinhole
    x: NDArray[np.float32]
    y: NDArray[np.float32]

    @classmethod
    def from_camera(cls, camera: OrdinaryCamera, margin: int) -> '_Distortion':
        """Of the camera's pixels and `margin` more on each side.

        Raises LightFieldError for a distortion that takes the picture too far out, as one does
        that holds in the middle only.
        """
        lens, pinhole = camera.lens, camera.pinhole
        v, u = np.mgrid[-margin:camera.height + margin, -margin:camera.width + margin]
        places = np.stack([u, v], axis=-1).reshape(-1, 2).astype(float)
        seen = places.copy()
        with np.errstate(all='ignore'):
            for _ in range(_TRIES):
                off = places - _distorted(camera, seen)
                seen += off
                if not abs(off).max() > _CLOSE:
                    break
        seen = seen.reshape(*u.shape, 2)
        low, high = np.floor(seen.min(axis=(0, 1))) - 2, np.ceil(seen.max(axis=(0, 1))) + 3
        size = high - low
        if not (abs(off).max() <= _CLOSE and size.prod() < _LARGEST * u.size):
            raise LightFieldError(
                f'{camera.model} distortion {list(lens.distortion)} cannot be undone over '
                f'{camera.width}x{camera.height} px: is it of pictures of another size? Of a lens '
                'that sees farther than about 80 degrees from its axis, simulate the middle of '
                'the picture: width, height, cx and cy of a part')
        left, top, width, height = (int(each) for each in (*low, *size))
        x, y = np.moveaxis((seen - low).astype(np.float32), -1, 0)
        return cls(pinhole.crop(left, top, width, height), x, y)


def _distorted(camera: OrdinaryCamera, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) where the lens shows what the pinhole shows at pixels (n, 2)."""
    rays = camera.pinhole.rays(pixels)
    of, still = np.array(camera.distortion, float), np.zeros(3)
    project = cv2.fisheye.projectPoints if camera.model == 'equidistant' else cv2.projectPoints
    shown = project(rays[None], still, still, camera.pinhole.matrix, of)[0]
    return np.asarray(shown, np.float64).reshape(-1, 2)


def take_picture(scene: Scene, camera: OrdinaryCamera, rng: np.random.Generator,
                samples: int = 16, renderer: Renderer = fast) -> NDArray[np.uint8]:
    """(height, width, 3) RGB, 8 bits, encoded by the camera's gamma: the scene seen by a camera.

    scene: its sensor is the camera's (`OrdinaryCamera.sensor`). samples: rays per pixel. The same
    scene and generator state give the same picture.
    """
    sensor, seen = scene.sensor, renderer(scene)
    margin = math.ceil(3 * sensor.blur)
    seed = int(rng.integers(2 ** 62))
    if camera.distortion:
        distortion = _Distortion.from_camera(camera, margin)
        wide = replace(sensor, grid=replace(sensor.grid, pinhole=distortion.pinhole))
        light = seen(wide, 0, 0, 0, samples, seed)
        light = np.maximum(np.asarray(cv2.remap(light, distortion.x, distortion.y,
                                                cv2.INTER_CUBIC), np.float32), np.float32(0))
    else:
        light = seen(sensor, 0, 0, margin, samples, seed)
    linear = sensed(light, exposure(light, sensor.level), sensor.blur, margin)
    linear = np.clip(noisy(linear, 1.0, sensor, rng), 0, 1)
    return np.rint(255 * linear ** np.float32(1 / camera.gamma)).astype(np.uint8)


def take_view(scene: Scene, camera: OrdinaryCamera, pose: NDArray[np.float64],
              rng: np.random.Generator, samples: int = 16) -> PosedView:
    """The scene from another pose (4, 4), of the camera to the scene's own, as it is read.

    The rest as of `take_picture`.
    """
    picture = take_picture(seen_from(scene, pose), camera, rng, samples)
    seen = camera.lens.undistorted(encoded(picture, camera.gamma), camera.pinhole)
    return PosedView(Header(frame_id='camera'), seen, camera.pinhole, pose)
