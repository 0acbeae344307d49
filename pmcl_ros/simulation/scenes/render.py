"""A scene -> the light field that a camera would decode of it, with its truth."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.scenes.rays import first_surfaces, light_of_view
from pmcl_ros.simulation.scenes.scene import Scene, Target
from pmcl_ros.simulation.scenes.sensing import exposure, noisy, sensed
from pmcl_ros.simulation.scenes.world import World

Progress = Callable[[float], None]


@dataclass(frozen=True)
class SyntheticCapture:
    """A light field and all that is known about it.

    labels: (height, width) int64, the target that a pixel of the centre view meets first, the
        number of targets for other solids, -1 for none. depth: (height, width) float32, of that
        surface [m], 0 for none. Both look through sheets. targets: of the scene.
    """

    light_field: LightField
    labels: NDArray[np.int64]
    depth: NDArray[np.float32]
    targets: tuple[Target, ...]

    def model(self, number: int = 0) -> ObjectModel:
        """A target as the localiser takes it."""
        target = self.targets[number]
        return ObjectModel(f'target {number}', target.vertices, target.faces, target.axis, True,
                           target.discrete)


def render(scene: Scene, rng: np.random.Generator, samples: int = 2,
           progress: Progress | None = None, header: Header | None = None) -> SyntheticCapture:
    """Render all views of a scene.

    samples: rays per pixel and view; the blur averages those of about ten pixels. progress: called
    with the part done. Views of weight 0 are black. The same scene and the same state of the
    generator give the same picture.
    """
    sensor, world = scene.sensor, World.of(scene)
    grid = sensor.grid
    margin = math.ceil(3 * sensor.blur)
    lit = [at for at in np.ndindex(grid.shape) if grid.weights[at] > 0]
    light = {}
    for number, (row, column) in enumerate(lit):
        light[row, column] = light_of_view(world, sensor, row, column, margin, samples,
                                           int(rng.integers(2 ** 62)))
        if progress is not None:
            progress((number + 1) / len(lit))
    gain = exposure(light[grid.centre], sensor.level)
    views = np.zeros((*grid.shape, grid.pinhole.height, grid.pinhole.width, 3), np.float32)
    for at in lit:
        view = sensed(light.pop(at), gain, sensor.blur, margin)
        views[at] = noisy(view, float(grid.weights[at]), sensor, rng)
    labels, depth = first_surfaces(world, grid.pinhole, np.array(scene.owners, np.int64))
    red, green, blue = (1 / each for each in sensor.gains)
    light_field = LightField(header or Header(), views, grid, colour=Colour((red, green, blue)))
    return SyntheticCapture(light_field, labels, depth, scene.targets)
