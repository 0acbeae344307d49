"""The centre view of a simulated Lytro, rendered directly: as it is decoded from a raw picture."""

import math

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.scenes.render import Renderer, fast
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.sensor import exposure, noisy, sensed


def centre_view(scene: Scene, camera: LytroCamera, rng: np.random.Generator, samples: int = 8,
                renderer: Renderer = fast) -> NDArray[np.uint8]:
    """(height, width, 3) RGB, 8 bits, encoded by the camera's gamma: as `LightField.picture`.

    scene: its sensor is the camera's (`LytroCamera.sensor`). samples: rays per pixel. Noise and
    saturation are those of the camera's own colours, before these become a screen's. The same
    scene and generator state give the same picture.
    """
    sensor, seen = scene.sensor, renderer(scene)
    margin = math.ceil(3 * sensor.blur)
    light = seen(sensor, *sensor.grid.centre, margin, samples, int(rng.integers(2 ** 62)))
    light = np.maximum(light @ camera.response.T.astype(np.float32), np.float32(0))
    linear = sensed(light, exposure(light, sensor.level), sensor.blur, margin)
    metadata = CameraMetadata.parse(camera.text())
    return Colour.from_metadata(metadata).displayed(noisy(linear, 1.0, sensor, rng),
                                                    metadata.image.color.gamma)
