"""A scene: objects in a room before a camera, as frozen values in the camera's frame, metres."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.appearance import Appearance
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.materials import Medium
from pmcl_ros.simulation.scenes.sensor import Sensor
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.textures import Texture


@dataclass(frozen=True)
class Decal:
    """A label or stains on the outside of a solid, matt; shown where scenes have lamps.

    heights: from and to, along the z axis of the solid [m]. azimuths: from and to, about it [rad].
    texture, side: as of `Opaque`. opacity: share of the light that comes from it. threshold: where
    the texture is darker than this there is nothing; 0: it covers all of its rectangle.
    """

    heights: tuple[float, float]
    azimuths: tuple[float, float]
    texture: Texture
    side: float
    opacity: float = 1.0
    threshold: float = 0.0


@dataclass(frozen=True)
class Solid:
    """Interfaces between media, in a frame of their own.

    surface: its media are numbers: 0 is the air around it, k is media[k - 1].
    pose: (4, 4), object to camera [m].
    """

    surface: Frusta | Triangles
    media: tuple[Medium, ...]
    pose: NDArray[np.float64]
    decal: Decal | None = None


@dataclass(frozen=True)
class Sheet:
    """A flat rectangle of `size` (width, height) [m], textured on both sides.

    pose: (4, 4), sheet to camera [m]; the origin is its centre, x runs along the width, y along
        the height.
    side: of one period of the texture [m]. opacity: share of the light that comes from the sheet;
        the rest comes from behind, undeflected.
    coat: refractive index of a coat; 1: none. roughness: of the coat, as in `Clear`; of a
        translucent sheet: standard deviation of the angle by which it scatters light [rad]. Both
        count where scenes have lamps.
    """

    pose: NDArray[np.float64]
    size: tuple[float, float]
    texture: Texture
    side: float
    opacity: float = 1.0
    coat: float = 1.0
    roughness: float = 0.0

    def is_between(self, eyes: NDArray[np.float64], middles: NDArray[np.float64]) -> bool:
        """Whether it is on the way from one of points (n, 3) to one of others (m, 3) [m]."""
        here, there = ((points - self.pose[:3, 3]) @ self.pose[:3, :3]
                       for points in (eyes[:, None], middles))
        ahead = there - here  # (eyes, middles, 3)
        with np.errstate(divide='ignore', invalid='ignore'):  # a ray along the sheet
            met = here[..., :2] - here[..., 2:] / ahead[..., 2:] * ahead[..., :2]
        apart = here[..., 2] * there[..., 2] < 0
        return bool((apart & (np.abs(met) < np.array(self.size) / 2).all(axis=-1)).any())


@dataclass(frozen=True)
class Target:
    """An object to localise: its outer surface, its true pose, its region of interest.

    vertices: (n, 3) [m], faces: (m, 3), closed, outward. axis: of its rotational symmetry, or
    None. pose: (4, 4), object to camera. roi_center, roi_size: camera's frame [m].
    empty: the object is not in the scene. discrete: (k, 4, 4) symmetries as in `ObjectModel`.
    appearance: what its user says that it is made of.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    axis: NDArray[np.float64] | None
    pose: NDArray[np.float64]
    roi_center: tuple[float, float, float]
    roi_size: tuple[float, float, float]
    empty: bool
    discrete: NDArray[np.float64] = field(default_factory=lambda: np.eye(4)[None])
    appearance: Appearance | None = None

    def model(self, name: str) -> ObjectModel:
        """It as a search knows it."""
        look = self.appearance
        return ObjectModel(name, self.vertices, self.faces, self.axis, True, self.discrete,
                           look is not None and look.is_clear,
                           None if look is None else look.declared_up)


@dataclass(frozen=True)
class Scene:
    """Everything that a picture shows.

    solids, sheets: what reflects, refracts or blocks light. environment: the light of the room;
    world_from_camera: (3, 3) rotates a direction of the camera into the panorama's frame (z up).
    targets: objects to localise. owners: for each solid the index of its target, or the number of
    targets for clutter. name: kind of scene and objects. origin: (3,) of the frame in which truth
    of several views is told, in the camera's frame [m]; default: the camera itself.
    """

    name: str
    solids: tuple[Solid, ...]
    sheets: tuple[Sheet, ...]
    environment: Environment
    world_from_camera: NDArray[np.float64]
    sensor: Sensor
    targets: tuple[Target, ...]
    owners: tuple[int, ...]
    origin: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    def hiding_sheets(self, eyes: NDArray[np.float64]) -> list[bool]:
        """Of each sheet, whether it is opaque and between the middle of a target and an eye.

        eyes: (n, 3) in the camera's frame [m].
        """
        middles = np.array([each.pose[:3, :3] @ each.vertices.mean(axis=0) + each.pose[:3, 3]
                            for each in self.targets])
        return [each.opacity == 1 and each.is_between(eyes, middles) for each in self.sheets]
