"""A scene: things in a room before a light-field camera. Frozen values, camera's frame, metres."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.materials import Medium
from pmcl_ros.simulation.scenes.revolution import Frusta
from pmcl_ros.simulation.scenes.sensor import Sensor
from pmcl_ros.simulation.scenes.textures import Texture
from pmcl_ros.simulation.scenes.triangles import Triangles


@dataclass(frozen=True)
class Solid:
    """One thing: interfaces between media, in a frame of its own.

    surface: its media are numbers: 0 is the air around all things, k is media[k - 1].
    pose: (4, 4), object to camera [m].
    """

    surface: Frusta | Triangles
    media: tuple[Medium, ...]
    pose: NDArray[np.float64]


@dataclass(frozen=True)
class Sheet:
    """A flat rectangle, textured on both sides, as large as `size` (width, height) [m].

    pose: (4, 4), its middle, x along the width, y along the height, to camera [m].
    side: of one texture [m]. opacity: the share of its light in what is seen; the rest comes from
    behind, undeflected.
    """

    pose: NDArray[np.float64]
    size: tuple[float, float]
    texture: Texture
    side: float
    opacity: float = 1.0


@dataclass(frozen=True)
class Target:
    """What is looked for: its outer surface, where it is, where to look.

    vertices: (n, 3) [m], faces: (m, 3), closed, outward. axis: of its rotational symmetry, or
    None. pose: (4, 4), object to camera. roi_center, roi_size: camera's frame [m].
    empty: it is not in the scene. discrete: (k, 4, 4) as of `ObjectModel`.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    axis: NDArray[np.float64] | None
    pose: NDArray[np.float64]
    roi_center: tuple[float, float, float]
    roi_size: tuple[float, float, float]
    empty: bool
    discrete: NDArray[np.float64] = field(default_factory=lambda: np.eye(4)[None])


@dataclass(frozen=True)
class Scene:
    """All that a picture is made of.

    solids, sheets: things that bend light, or stop it. environment: what is seen past all of
    them; world_from_camera: (3, 3) turns a direction of the camera into one of its panorama (z
    up). targets: things to look for. owners: for each solid the number of the target that it is
    part of, or the number of targets. name: what kind of scene it is.
    """

    name: str
    solids: tuple[Solid, ...]
    sheets: tuple[Sheet, ...]
    environment: Environment
    world_from_camera: NDArray[np.float64]
    sensor: Sensor
    targets: tuple[Target, ...]
    owners: tuple[int, ...]
