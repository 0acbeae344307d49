"""Rays of all pixels of all views, and the light along them."""

import numpy as np
from numba import prange
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.kernels import LOCK, compiled
from pmcl_ros.simulation.scenes.nearest import nearest
from pmcl_ros.simulation.scenes.random_numbers import chance
from pmcl_ros.simulation.scenes.scene import Sensor
from pmcl_ros.simulation.scenes.trace import BRANCHES, trace
from pmcl_ros.simulation.scenes.world import World

_DEPTH = 64  # of a hierarchy of boxes
_R1, _R2 = 0.7548776662466927, 0.5698402909980532  # powers of the plane's golden ratio


def light_of_view(world: World, sensor: Sensor, row: int, column: int, margin: int, samples: int,
                  seed: int) -> NDArray[np.float32]:
    """(height + 2 margin, width + 2 margin, 3) mean radiance of a view's pixels, noise-free.

    Rectified as `ViewGrid`; each of `samples` rays leaves from another place of the view's part of
    the pupil, through another of the pixel, and meets the others in the plane of focus. Places in
    pixels are those of a low-discrepancy lattice: neighbouring pixels share the work.
    """
    grid = sensor.grid
    camera = grid.pinhole.crop(-margin, -margin, grid.pinhole.width + 2 * margin,
                               grid.pinhole.height + 2 * margin)
    numbers = np.array([camera.fx, camera.fy, camera.cx, camera.cy, grid.baseline,
                        *grid.positions[row, column], column - grid.centre[1],
                        row - grid.centre[0], sensor.focus, sensor.pupil])
    picture = np.zeros((camera.height, camera.width, 3), np.float32)
    with LOCK:
        _render(world, numbers, samples, np.uint64(seed), picture)
    return picture


def first_surfaces(world: World, pinhole: Pinhole, owners: NDArray[np.int64]
                   ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Per pixel of the centre view (height, width): whose solid is met first, and its depth.

    owners: (solids,) numbers to tell them by. -1 where there is none; the depth [m], 0 there.
    Sheets are looked through.
    """
    label = np.full((pinhole.height, pinhole.width), -1, np.int64)
    depth = np.zeros((pinhole.height, pinhole.width), np.float32)
    clear = world._replace(sheets=world.sheets[:0])
    with LOCK:
        _first(clear, np.array([pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy]), label, depth)
    return np.append(owners, -1)[label], depth


@compiled(parallel=True)
def _render(world, numbers, samples, seed, picture):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy, baseline, at_x, at_y, nominal_x, nominal_y, focus, pupil = numbers
    height, width = picture.shape[0], picture.shape[1]
    start = np.full(1, seed, np.uint64)
    shift_x, shift_y = chance(start), chance(start)
    for i in prange(height):
        state = np.full(1, seed + np.uint64(i) * np.uint64(0xD1342543DE82EF95), np.uint64)
        waiting, hit = np.zeros((BRANCHES, 10)), np.zeros(9)
        stack, light = np.zeros(_DEPTH, np.int64), np.zeros(3)
        for j in range(width):
            light[:] = 0
            for k in range(samples):
                px, py = _pupil(state, nominal_x, nominal_y, pupil)
                ox, oy = baseline * px, baseline * py
                number = i * samples + k
                u = j + (shift_x + _R1 * number + _R2 * j) % 1 - 0.5 - cx
                v = i + (shift_y + _R2 * number + _R1 * j) % 1 - 0.5 - cy
                tx = u / fx * focus + baseline * at_x
                ty = v / fy * focus + baseline * at_y
                dx, dy, dz = tx - ox, ty - oy, focus
                length = np.sqrt(dx * dx + dy * dy + dz * dz)
                trace(world, waiting, hit, stack, state, light, ox, oy, 0.0, dx / length,
                      dy / length, dz / length)
            for channel in range(3):
                picture[i, j, channel] = light[channel] / samples


@compiled()
def _pupil(state, x, y, radius):  # type: ignore[no-untyped-def]
    """A place of a view's part of the pupil [view steps]: a tent about (x, y) cut by the disc."""
    for _ in range(200):
        px = x + 2 * (chance(state) + chance(state) - 1)
        py = y + 2 * (chance(state) + chance(state) - 1)
        if px * px + py * py <= radius * radius:
            return px, py
    return x, y


@compiled(parallel=True)
def _first(world, numbers, label, depth):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = numbers
    height, width = label.shape
    for i in prange(height):
        hit, stack = np.zeros(9), np.zeros(_DEPTH, np.int64)
        for j in range(width):
            dx, dy, dz = (j - cx) / fx, (i - cy) / fy, 1.0
            length = np.sqrt(dx * dx + dy * dy + 1)
            kind, t, number, _, _ = nearest(world, hit, stack, 0.0, 0.0, 0.0, dx / length,
                                            dy / length, dz / length)
            if kind == 1:
                label[i, j] = number
                depth[i, j] = t / length
