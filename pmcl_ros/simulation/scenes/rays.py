"""The light along given rays, by the package's own renderer."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.kernels import borrowed, compiled, rounds
from pmcl_ros.simulation.scenes.lit import follow
from pmcl_ros.simulation.scenes.sampling import stream
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.trace import BRANCHES, DEPTH
from pmcl_ros.simulation.scenes.world import World

_BLOCK = 4096  # rays of one task
# (origins (n, 3), unit directions (n, 3), seed) to radiances (n, 3) float32; the camera's frame.
LightAlong = Callable[[NDArray[np.float64], NDArray[np.float64], int], NDArray[np.float32]]
RayRenderer = Callable[[Scene], LightAlong]


def fast_along(scene: Scene) -> LightAlong:
    """As `render.fast`, along any rays."""
    return partial(light_along, World.from_scene(scene))


def light_along(world: World, origins: NDArray[np.float64], directions: NDArray[np.float64],
                seed: int) -> NDArray[np.float32]:
    """(n, 3) radiance that comes to each origin from its direction."""
    light = np.zeros((len(origins), 3), np.float32)
    _follow(world, np.ascontiguousarray(origins), np.ascontiguousarray(directions), _BLOCK,
            np.uint64(seed), light)
    return light


@compiled(parallel=True, exact=True)
def _follow(world, origins, directions, block, seed, out, portion):  # type: ignore[no-untyped-def]
    world = borrowed(world)
    for task in rounds(-(-len(out) // block), portion):
        state = stream(seed, task)
        waiting, hit, other = np.zeros((BRANCHES, 10)), np.zeros(9), np.zeros(9)
        stack, light, seen = np.zeros(DEPTH, np.int64), np.zeros(3), np.full(2, 0.5)
        for n in range(task * block, min((task + 1) * block, len(out))):
            o, d = origins[n], directions[n]
            light[:] = 0
            follow(world, waiting, hit, other, stack, state, seen, light, o[0], o[1], o[2],
                   d[0], d[1], d[2])
            for channel in range(3):
                out[n, channel] = light[channel]
