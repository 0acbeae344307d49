"""Draws random objects: vessels of glass (empty, filled, massive), opaque bodies, boxes."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.pmcl.appearance import Appearance
from pmcl_ros.simulation.scenes.materials import Medium, Opaque, random_glass, random_liquid
from pmcl_ros.simulation.scenes.poses import Pose, resting
from pmcl_ros.simulation.scenes.scene import Sheet, Solid, Target
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.shapes.vessels import Vessel, outer_mesh, random_vessel
from pmcl_ros.simulation.scenes.textures import random_texture

_WAYS = {'upright': 0.5, 'lying': 0.2, 'tilted': 0.25, 'head down': 0.05}  # probabilities

Finish = Callable[[np.random.Generator], Opaque]
Circle = tuple[NDArray[np.float64], float]  # middle (2,) and radius of a footprint [m]


@dataclass(frozen=True)
class SceneObject:
    """An object that can be placed at any pose.

    solids: their poses are in the object's frame. vertices, faces: its closed outer surface [m].
    axis: of its rotational symmetry, or None. way: in which it rests, as of `poses.resting`;
    '': any. up: (3,) what points up when it stands. discrete: (k, 4, 4) symmetries as in
    `ObjectModel`. appearance: as of `Target`.
    """

    name: str
    solids: tuple[Solid, ...]
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    axis: NDArray[np.float64] | None
    way: str = ''
    up: NDArray[np.float64] = field(default_factory=lambda: np.array([0, 0, 1.0]))
    discrete: NDArray[np.float64] = field(default_factory=lambda: np.eye(4)[None])
    appearance: Appearance | None = None

    @classmethod
    def from_mesh(cls, mesh: trimesh.Trimesh, medium: Medium, name: str = 'mesh') -> 'SceneObject':
        """A closed mesh [m] filled with one medium; its own symmetry is not searched for."""
        surface = Triangles(np.asarray(mesh.triangles, float), 0, 1)
        return cls(name, (Solid(surface, (medium,), np.eye(4)),),
                   np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64), None)

    def at_rest(self, rng: np.random.Generator) -> Pose:
        """Draw its pose (4, 4) in the world, on the table z = 0 above the origin."""
        way = self.way or str(rng.choice(list(_WAYS), p=list(_WAYS.values())))
        return resting(rng, self.vertices, way, self.up)

    def placed(self, pose: Pose) -> tuple[Solid, ...]:
        """Its solids with the object at a pose (4, 4), object to camera."""
        return tuple(replace(each, pose=pose @ each.pose) for each in self.solids)

    def footprint(self, rest: Pose) -> Circle:
        """The circle on the table about the object at a pose of `at_rest`."""
        flat = (self.vertices @ rest[:3, :3].T + rest[:3, 3])[:, :2]
        middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
        return middle, float(np.linalg.norm(flat - middle, axis=1).max())

    def target(self, pose: Pose, roi_center: NDArray[np.float64], roi_size: NDArray[np.float64],
               empty: bool = False) -> Target:
        """It to be localised at a pose (4, 4), object to camera. The rest as of `Target`."""
        (x, y, z), (width, height, depth) = roi_center.tolist(), roi_size.tolist()
        return Target(self.vertices, self.faces, self.axis, pose, (x, y, z),
                      (width, height, depth), empty, self.discrete, self.appearance)


def random_transparent(rng: np.random.Generator, walls: tuple[float, float] = (0.0012, 0.005)
                       ) -> SceneObject:
    """A vessel of glass: massive (6 %), filled (22 %), with a ball in it (8 %) or empty.

    walls: limits of their thickness [m].
    """
    vessel, glass = random_vessel(rng, walls=walls), random_glass(rng)
    draw = rng.random()
    media: list[Medium] = [glass]
    more: tuple[Solid, ...] = ()
    if draw < 0.06:
        surface, kind = Frusta.from_profile(vessel.closed, 0, 1), 'massive'
    elif draw < 0.28:
        floor, rim = vessel.inner[-1, 1], vessel.inner[0, 1]
        level = floor + rng.uniform(0.15, 0.85) * (rim - floor)
        surface, kind = vessel.surface(level), 'filled'
        media.append(random_liquid(rng))
    else:
        surface, kind = vessel.surface(), 'glass'
        if draw < 0.36:
            more, kind = _content(rng, vessel), 'glass with content'
    return _of_vessel(f'{kind} {vessel.kind}', vessel,
                      (Solid(surface, tuple(media), np.eye(4)), *more),
                      'upright' if kind in ('filled', 'glass with content') else '')


def random_opaque(rng: np.random.Generator, finish: Finish | None = None) -> SceneObject:
    """A body of a vessel's shape, closed (75 %) or open, matt or glossy.

    finish: draws what it is made of; default: `random_finish`.
    """
    vessel = random_vessel(rng)
    is_open = rng.random() < 0.25
    surface = vessel.surface() if is_open else Frusta.from_profile(vessel.closed, 0, 1)
    solid = Solid(surface, ((finish or random_finish)(rng),), np.eye(4))
    return _of_vessel(f'opaque {vessel.kind}', vessel, (solid,))


def random_finish(rng: np.random.Generator) -> Opaque:
    """Matt or glossy, printed or of one colour."""
    texture = random_texture(rng, ('lettering', 'clouds', 'plain', 'plain', 'checks', 'grain'))
    coat = float(rng.uniform(1.35, 1.6)) if rng.random() < 0.5 else 1.0
    return Opaque(texture, float(rng.uniform(0.06, 0.25)), coat)


def random_box(rng: np.random.Generator) -> list[Sheet]:
    """The five visible sides of a textured box that stands on z = 0 above the origin."""
    size = rng.uniform(0.02, 0.12, 3)
    texture, side = random_texture(rng), float(rng.uniform(0.08, 0.3))
    sheets = []
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1)):
        middle = np.array([0, 0, size[2] / 2])
        middle[axis] += sign * size[axis] / 2
        turn = {0: Rotation.from_euler('y', np.pi / 2), 1: Rotation.from_euler('x', np.pi / 2),
                2: Rotation.identity()}[axis]
        width, height = {0: (size[2], size[1]), 1: (size[0], size[2]),
                         2: (size[0], size[1])}[axis]
        sheets.append(Sheet(pose_of(turn, middle), (width, height), texture, side))
    return sheets


def _content(rng: np.random.Generator, vessel: Vessel) -> tuple[Solid, ...]:
    """A ball on the floor of the cavity; none where the cavity is too narrow."""
    floor = vessel.inner[-1, 1]
    heights = np.linspace(floor + 0.004, vessel.inner[0, 1], 50)
    radii = np.interp(heights, vessel.inner[::-1, 1], vessel.inner[::-1, 0])
    radius = float(min(rng.uniform(0.3, 0.8) * radii[:20].min(), 0.25 * np.ptp(heights)))
    if radius < 0.004:
        return ()
    turn = np.linspace(-np.pi / 2, np.pi / 2, 40)
    profile = radius * np.stack([np.abs(np.cos(turn)), np.sin(turn)], axis=1)
    ball = Frusta.from_profile(profile, 0, 1)
    middle = np.array([0, 0, floor + radius + 0.003])
    return (Solid(ball, (random_finish(rng),), pose_of(Rotation.random(None, rng), middle)),)


def _of_vessel(name: str, vessel: Vessel, solids: tuple[Solid, ...],
               way: str = '') -> SceneObject:
    vertices, faces = outer_mesh(vessel.closed)
    return SceneObject(name, solids, vertices, faces, np.array([0, 0, 1.0]), way)
