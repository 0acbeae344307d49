"""A scene seen by an ordinary camera from other places."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.light_field import ViewGrid, nominal_positions
from pmcl_ros.lightfield.sweep.frame import Lens, SweepFrame
from pmcl_ros.simulation.scenes.rays import light_of_view
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.sensing import exposure, noisy, sensed
from pmcl_ros.simulation.scenes.world import World

_APERTURE = 0.0003  # m: a quarter of its width
_GAMMA = 2.2
_PERIOD_NS = 1_000_000_000  # between two pictures


def seen_from(scene: Scene, pose: NDArray[np.float64]) -> Scene:
    """The scene with its camera moved to `pose` (4, 4), told in the old camera's frame.

    Regions of interest stay where they are in the camera's frame.
    """
    back = np.linalg.inv(pose)
    return replace(
        scene, solids=tuple(replace(each, pose=back @ each.pose) for each in scene.solids),
        sheets=tuple(replace(each, pose=back @ each.pose) for each in scene.sheets),
        targets=tuple(replace(each, pose=back @ each.pose) for each in scene.targets),
        world_from_camera=scene.world_from_camera @ pose[:3, :3])


def photographs(scene: Scene, poses: Sequence[NDArray[np.float64]], rng: np.random.Generator,
                samples: int = 2, stamp_ns: int = 0) -> list[SweepFrame]:
    """Pictures that an ordinary camera takes at `poses` (n, 4, 4), told in the scene's camera.

    It is a camera of the pixels, the noise and the blur of the scene's, with a small aperture and
    no distortion; exposed as for the first picture, 8 bits, gamma 2.2, one a second from
    `stamp_ns` on.
    """
    pinhole = scene.sensor.grid.pinhole
    grid = ViewGrid(pinhole, _APERTURE, nominal_positions(1, 1), np.ones((1, 1), np.float32))
    sensor = replace(scene.sensor, grid=grid, gains=(1.0, 1.0, 1.0))
    margin = int(np.ceil(3 * sensor.blur))
    frames, gain = [], 0.0
    for number, pose in enumerate(poses):
        world = World.of(seen_from(scene, pose))
        light = light_of_view(world, sensor, 0, 0, margin, samples, int(rng.integers(2 ** 62)))
        gain = gain or exposure(light, sensor.level)
        linear = noisy(sensed(light, gain, sensor.blur, margin), 1.0, sensor, rng)
        image = np.rint(255 * np.clip(linear, 0, 1) ** (1 / _GAMMA)).astype(np.uint8)
        frames.append(SweepFrame(f'{number:03d}', stamp_ns + number * _PERIOD_NS, image,
                                 Lens(pinhole), np.asarray(pose, float)))
    return frames
