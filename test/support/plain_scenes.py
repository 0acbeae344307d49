"""Scenes of which everything is known: one light, one object, no noise."""

import numpy as np

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import ViewGrid, nominal_positions
from pmcl_ros.runtime.kernels import compiled
from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.sensor import Sensor
from pmcl_ros.simulation.scenes.textures import SIZE
from pmcl_ros.simulation.scenes.trace import BRANCHES, trace

WHITE = np.ones((SIZE, SIZE, 3), np.float32)


def pose_at(x, y, z):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def plain_sensor(size=64, views=3, fx=180.0, blur=0.0, baseline=0.0008, focus=0.5):
    """A camera without noise."""
    pinhole = Pinhole(size, size, fx, fx, (size - 1) / 2, (size - 1) / 2)
    grid = ViewGrid(pinhole, baseline, nominal_positions(views, views),
                    np.ones((views, views), np.float32))
    return Sensor(grid, focus, 4.2, blur, 0.4, 0.0, 0.0, (1.0, 1.0, 1.0))


def plain_scene(solids=(), sheets=(), light=1.0, sensor=None, targets=(), owners=None):
    """Objects in a room that is equally bright everywhere."""
    room = Environment(np.full((16, 32, 3), light, np.float32))
    return Scene('plain', tuple(solids), tuple(sheets), room, np.eye(3),
                 sensor or plain_sensor(), tuple(targets),
                 tuple(owners if owners is not None else [len(targets)] * len(solids)))


@compiled()
def _along(world, origins, directions, seed, light):
    waiting, hit, stack = np.zeros((BRANCHES, 10)), np.zeros(9), np.zeros(64, np.int64)
    state = np.full(1, seed, np.uint64)
    for k in range(len(origins)):
        o, d = origins[k], directions[k]
        trace(world, waiting, hit, stack, state, light[k], o[0], o[1], o[2], d[0], d[1], d[2])


def light_along(world, origins, directions, seed=0):
    """(n, 3) radiance along rays (n, 3), (n, 3)."""
    light = np.zeros((len(origins), 3))
    _along(world, np.asarray(origins, float), np.asarray(directions, float), np.uint64(seed),
           light)
    return light


def rays_through(rng, count, centre, radius):
    """Origins on a sphere about a centre, directions through points near it."""
    origins = rng.standard_normal((count, 3))
    origins = centre + 4 * radius * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    ends = centre + radius * rng.uniform(-0.8, 0.8, (count, 3))
    way = ends - origins
    return origins, way / np.linalg.norm(way, axis=1, keepdims=True)
