"""Draws random vessels with a handle or a spout, of glass or opaque."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pmcl_ros.simulation.scenes.materials import random_glass
from pmcl_ros.simulation.scenes.objects import Finish, SceneObject, random_finish
from pmcl_ros.simulation.scenes.scene import Solid
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.shapes.vessels import Vessel, outer_mesh, random_vessel

_SIDES, _PIECES = 20, 28  # of a tube: around it and along it
_SPOUT = 0.3  # share of objects with a spout beside the handle

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]


def random_handled(rng: np.random.Generator, glass: bool, finish: Finish | None = None
                   ) -> SceneObject:
    """A cup, jug or pot: a vessel with a handle, and 30 % with a spout.

    finish: draws what an opaque one is made of; default: `random_finish`.
    """
    vessel = random_vessel(rng, ('tumbler', 'jar', 'bowl', 'tumbler', 'free'))
    medium = random_glass(rng) if glass else (finish or random_finish)(rng)
    solids = [Solid(vessel.surface(), (medium,), np.eye(4))]
    meshes = [outer_mesh(vessel.closed)]
    tubes = [_handle(rng, vessel)] + ([_spout(rng, vessel)] if rng.random() < _SPOUT else [])
    for vertices, faces in tubes:
        solids.append(Solid(Triangles(vertices[faces], 0, 1), (medium,), np.eye(4)))
        meshes.append((vertices, faces))
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in meshes[:-1]])
    parts = 'handle and spout' if len(tubes) > 1 else 'handle'
    return SceneObject(
        f'{"glass" if glass else "opaque"} {vessel.kind} with {parts}', tuple(solids),
        np.concatenate([vertices for vertices, _ in meshes]),
        np.concatenate([faces + start for (_, faces), start in zip(meshes, starts, strict=True)]),
        None)


def _wall(vessel: Vessel, z: float) -> float:
    """The radius in the middle of the wall at a height [m]."""
    outer = np.interp(z, vessel.outer[:, 1], vessel.outer[:, 0])
    inner = np.interp(z, vessel.inner[::-1, 1], vessel.inner[::-1, 0])
    return float(outer - min(0.5 * (outer - inner), 0.001))


def _handle(rng: np.random.Generator, vessel: Vessel) -> Mesh:
    """A bent tube in the plane y = 0, both ends in the wall."""
    foot, rim = vessel.outer[0, 1], vessel.outer[-1, 1]
    low = foot + (rim - foot) * rng.uniform(0.12, 0.4)
    high = foot + (rim - foot) * rng.uniform(0.65, 0.93)
    out = rng.uniform(0.018, 0.04)
    start, end = _wall(vessel, high), _wall(vessel, low)
    far = vessel.outer[:, 0].max() + out
    lift, droop = rng.uniform(-0.1, 0.25), rng.uniform(-0.25, 0.1)
    height = high - low
    points = np.array([[start, high], [0.4 * start + 0.6 * far, high + lift * height],
                       [far, 0.5 * (high + low) + rng.uniform(-0.15, 0.15) * height],
                       [0.4 * end + 0.6 * far, low + droop * height], [end, low]])
    thick = rng.uniform(0.0025, 0.006)
    return _tube(points, np.full(2, thick), rng.uniform(0.7, 1.8))


def _spout(rng: np.random.Generator, vessel: Vessel) -> Mesh:
    """A tapered tube from the wall outwards and up, on the side away from the handle."""
    foot, rim = vessel.outer[0, 1], vessel.outer[-1, 1]
    low = foot + (rim - foot) * rng.uniform(0.25, 0.6)
    top = rim + rng.uniform(-0.1, 0.15) * (rim - foot)
    start = _wall(vessel, low)
    far = vessel.outer[:, 0].max() + rng.uniform(0.02, 0.05)
    middle = np.array([0.6 * start + 0.4 * far, 0.7 * low + 0.3 * top])
    points = -np.array([1, -1]) * np.array([[start, low], middle, [far, top]])
    return _tube(points, rng.uniform([0.007, 0.004], [0.011, 0.006]), 1.0)


def _tube(points: NDArray[np.float64], radii: NDArray[np.float64], flat: float) -> Mesh:
    """A closed tube along a curve through points (n, 2) of (x, z) [m].

    radii: at its first and last end [m]. flat: its width along y over that in the plane.
    """
    at = np.linspace(0, 1, _PIECES)
    curve = CubicSpline(np.linspace(0, 1, len(points)), points)
    middle, along = curve(at), curve(at, 1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    radius = radii[0] + at * (radii[1] - radii[0])
    turn = 2 * np.pi * np.arange(_SIDES) / _SIDES
    aside = radius[:, None] * np.cos(turn)
    rings = np.stack([middle[:, :1] + along[:, 1:] * aside,
                      flat * radius[:, None] * np.sin(turn),
                      middle[:, 1:] - along[:, :1] * aside], axis=-1)
    vertices = np.concatenate([rings.reshape(-1, 3), rings[0].mean(0)[None],
                               rings[-1].mean(0)[None]])
    k, m = np.meshgrid(np.arange(_PIECES - 1), np.arange(_SIDES), indexing='ij')
    a, b = k * _SIDES + m, k * _SIDES + (m + 1) % _SIDES
    c, d = a + _SIDES, b + _SIDES
    first, ring = len(vertices) - 2, np.arange(_SIDES)
    last = (_PIECES - 1) * _SIDES
    following = (ring + 1) % _SIDES
    faces = np.concatenate([
        np.stack([a, b, d], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3),
        np.stack([np.full(_SIDES, first), following, ring], axis=1),
        np.stack([np.full(_SIDES, first + 1), last + ring, last + following], axis=1)])
    if trimesh.Trimesh(vertices, faces, process=False).volume < 0:
        faces = faces[:, ::-1]
    return vertices, faces
