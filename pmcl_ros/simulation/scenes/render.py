"""The package's own renderer: light fields and photographs of scenes, with exact truth."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import GAMMA
from pmcl_ros.lightfield.sweep.frame import Lens, SweepFrame
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.kernels import borrowed, compiled, rounds
from pmcl_ros.simulation.scenes.broad_scene import broad_scene
from pmcl_ros.simulation.scenes.lit import follow
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene
from pmcl_ros.simulation.scenes.sampling import eye_ray, stream, uniform
from pmcl_ros.simulation.scenes.scene import Scene, Target
from pmcl_ros.simulation.scenes.sensor import Sensor, exposure, noisy, one_view, sensed
from pmcl_ros.simulation.scenes.trace import BRANCHES, DEPTH, nearest
from pmcl_ros.simulation.scenes.world import World

_SAMPLES = 2  # rays of a pixel, in a picture of a small aperture
_PERIOD_NS = 1_000_000_000  # between two pictures
# (sensor, row, column, margin, samples, seed) to the radiance of a view, as `light_of_view`.
LightOfView = Callable[[Sensor, int, int, int, int, int], NDArray[np.float32]]
Renderer = Callable[[Scene], LightOfView]


def fast(scene: Scene) -> LightOfView:
    """The package's own renderer: reflections and refractions, shadows where there are lamps."""
    return partial(light_of_view, World.from_scene(scene))


def light_of_view(world: World, sensor: Sensor, row: int, column: int, margin: int, samples: int,
                  seed: int) -> NDArray[np.float32]:
    """(height + 2 margin, width + 2 margin, 3) mean radiance of a view's pixels, noise-free.

    Rectified as `ViewGrid`. Each of `samples` rays of a pixel starts at a random point of the
    view's part of the pupil; all of them meet in the plane of focus. Points within pixels form a
    low-discrepancy lattice over neighbouring pixels. Shadows are cast where the environment has
    lamps.
    """
    grid = sensor.grid
    camera = grid.pinhole.crop(-margin, -margin, grid.pinhole.width + 2 * margin,
                               grid.pinhole.height + 2 * margin)
    numbers = np.array([camera.fx, camera.fy, camera.cx, camera.cy, grid.baseline,
                        *grid.positions[row, column], column - grid.centre[1],
                        row - grid.centre[0], sensor.focus, sensor.pupil])
    picture = np.zeros((camera.height, camera.width, 3), np.float32)
    _render(world, numbers, samples, np.uint64(seed), picture)
    return picture


def first_surfaces(world: World, pinhole: Pinhole, owners: NDArray[np.int64],
                   with_sheets: bool = False, where: NDArray[np.bool_] | None = None
                   ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Owner and depth of the first solid at each pixel of the centre view, (height, width) each.

    owners: (solids,) a number for each solid; -1 where no solid is. The depth is in metres, 0
    where nothing is. Sheets are ignored, or with_sheets: opaque ones hide what is behind them and
    have a depth. where: (height, width) pixels that count, default all.
    """
    if where is None:
        where = np.ones((pinhole.height, pinhole.width), bool)
    label = np.full((pinhole.height, pinhole.width), -1, np.int64)
    depth = np.zeros((pinhole.height, pinhole.width), np.float32)
    seen = with_sheets & (world.sheets[:, 16] >= 1)
    _first(world._replace(sheets=world.sheets[seen]),
           np.array([pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy]), where, label, depth)
    return np.append(owners, -1)[label], depth


@compiled(parallel=True, exact=True)
def _render(world, numbers, samples, seed, picture, portion):  # type: ignore[no-untyped-def]
    world = borrowed(world)
    height, width = picture.shape[0], picture.shape[1]
    start = np.full(1, seed, np.uint64)
    shift_x, shift_y = uniform(start), uniform(start)
    for i in rounds(height, portion):
        state = stream(seed, i)
        waiting, hit, other = np.zeros((BRANCHES, 10)), np.zeros(9), np.zeros(9)
        stack, light, seen = np.zeros(DEPTH, np.int64), np.zeros(3), np.full(2, 0.5)
        for j in range(width):
            light[:] = 0
            for k in range(samples):
                ox, oy, dx, dy, dz = eye_ray(state, numbers, shift_x, shift_y, i, j,
                                             i * samples + k)
                follow(world, waiting, hit, other, stack, state, seen, light, ox, oy, 0.0, dx, dy,
                       dz)
            for channel in range(3):
                picture[i, j, channel] = light[channel] / samples


@compiled(parallel=True, exact=True)
def _first(world, numbers, where, label, depth, portion):  # type: ignore[no-untyped-def]
    world = borrowed(world)
    fx, fy, cx, cy = numbers
    height, width = label.shape
    for i in rounds(height, portion):
        hit, stack = np.zeros(9), np.zeros(DEPTH, np.int64)
        for j in range(width):
            if not where[i, j]:
                continue
            dx, dy, dz = (j - cx) / fx, (i - cy) / fy, 1.0
            length = np.sqrt(dx * dx + dy * dy + 1)
            kind, t, number, _, _ = nearest(world, hit, stack, 0.0, 0.0, 0.0, dx / length,
                                            dy / length, dz / length)
            if kind > 0:
                depth[i, j] = t / length
            if kind == 1:
                label[i, j] = number


@dataclass(frozen=True)
class SyntheticCapture:
    """A light field and its truth.

    labels: (height, width) int64, the target at each pixel of the centre view, the number of
        targets for other solids, -1 for none. depth: (height, width) float32, of the first
        surface [m], 0 for none. Both ignore sheets. targets: of the scene.
    """

    light_field: LightField
    labels: NDArray[np.int64]
    depth: NDArray[np.float32]
    targets: tuple[Target, ...]

    def model(self, number: int = 0) -> ObjectModel:
        """A target as an object model."""
        return self.targets[number].model(f'target {number}')


def render(scene: Scene, rng: np.random.Generator, samples: int = 2,
           progress: Callable[[float], None] | None = None, renderer: Renderer = fast
           ) -> SyntheticCapture:
    """Render all views of a scene.

    samples: rays per pixel and view; the blur averages those of about ten pixels. progress: called
    with the share done, 0 to 1. Views of weight 0 are black. The same scene and generator state
    give the same picture.
    """
    sensor, seen = scene.sensor, renderer(scene)
    grid = sensor.grid
    margin = math.ceil(3 * sensor.blur)
    lit = [at for at in np.ndindex(grid.shape) if grid.weights[at] > 0]
    light = {}
    for number, (row, column) in enumerate(lit):
        light[row, column] = seen(sensor, row, column, margin, samples,
                                  int(rng.integers(2 ** 62)))
        if progress is not None:
            progress((number + 1) / len(lit))
    gain = exposure(light[grid.centre], sensor.level)
    views = np.zeros((*grid.shape, grid.pinhole.height, grid.pinhole.width, 3), np.float32)
    for at in lit:
        view = sensed(light.pop(at), gain, sensor.blur, margin)
        views[at] = noisy(view, float(grid.weights[at]), sensor, rng)
    labels, depth = first_surfaces(World.from_scene(scene), grid.pinhole,
                                   np.array(scene.owners, np.int64))
    red, green, blue = (1 / each for each in sensor.gains)
    light_field = LightField(Header(), views, grid, colour=Colour((red, green, blue)))
    return SyntheticCapture(light_field, labels, depth, scene.targets)


def seen_from(scene: Scene, pose: NDArray[np.float64]) -> Scene:
    """The scene with its camera moved to `pose` (4, 4), new camera to old camera.

    Regions of interest keep their coordinates in the camera's frame.
    """
    back = np.linalg.inv(pose)
    return replace(
        scene, solids=tuple(replace(each, pose=back @ each.pose) for each in scene.solids),
        sheets=tuple(replace(each, pose=back @ each.pose) for each in scene.sheets),
        targets=tuple(replace(each, pose=back @ each.pose) for each in scene.targets),
        world_from_camera=scene.world_from_camera @ pose[:3, :3],
        origin=back[:3, :3] @ scene.origin + back[:3, 3])


def photographs(scene: Scene, poses: Sequence[NDArray[np.float64]], rng: np.random.Generator,
                stamp_ns: int = 0) -> list[SweepFrame]:
    """Photographs by an ordinary camera at `poses` (n, 4, 4), in the frame of the scene's camera.

    The camera has the pixels, noise and blur of the scene's, a small aperture and no distortion.
    All pictures have the exposure of the first one, 8 bits and gamma 2.2; one a second from
    `stamp_ns` on.
    """
    pinhole = scene.sensor.grid.pinhole
    sensor = replace(scene.sensor, grid=one_view(pinhole), gains=(1.0, 1.0, 1.0))
    margin = int(np.ceil(3 * sensor.blur))
    frames, gain = [], 0.0
    for number, pose in enumerate(poses):
        world = World.from_scene(seen_from(scene, pose))
        light = light_of_view(world, sensor, 0, 0, margin, _SAMPLES, int(rng.integers(2 ** 62)))
        gain = gain or exposure(light, sensor.level)
        linear = noisy(sensed(light, gain, sensor.blur, margin), 1.0, sensor, rng)
        image = np.rint(255 * np.clip(linear, 0, 1) ** (1 / GAMMA)).astype(np.uint8)
        frames.append(SweepFrame(f'{number:03d}', stamp_ns + number * _PERIOD_NS, image,
                                 Lens(pinhole), np.asarray(pose, float)))
    return frames


def warm_up() -> None:
    """Compile the kernels, or load them from disk."""
    rng = np.random.default_rng(0)
    settings = SceneSettings(views=3, size=64)
    for draw in (random_scene, broad_scene):
        render(draw(rng, settings), rng, samples=1)
