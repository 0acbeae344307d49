"""Where a described object is put, and what stands around it."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.simulation.scenes.broad_scene import Palette
from pmcl_ros.simulation.scenes.materials import Medium
from pmcl_ros.simulation.scenes.objects import Circle, SceneObject
from pmcl_ros.simulation.scenes.poses import Pose, random_heading
from pmcl_ros.simulation.scenes.scene import Sheet, Solid
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.textures import Texture

_WALL = Rotation.from_euler('x', np.pi / 2)  # a sheet that stands across y


@dataclass(frozen=True)
class Place:
    """An object at rest above the origin of a world (z up, its support z = 0), and a camera.

    item: the object. world: (4, 4), object to world. top: its height there [m]. camera: (4, 4),
    world to camera. circles: footprints (`objects.Circle`), the object's first. near: least
    distance of the camera [m]. empty: the object is not there.
    """

    item: SceneObject
    world: Pose
    top: float
    camera: Pose
    circles: list[Circle]
    palette: Palette
    near: float
    empty: bool

    @property
    def reach(self) -> float:
        """Radius of the object's footprint [m]."""
        return self.circles[0][1]

    @property
    def stands(self) -> bool:
        """Whether the object is upright."""
        return bool(self.world[2, :3] @ self.item.up > 1 - 1e-9)

    @property
    def target(self) -> tuple[Solid, ...]:
        """The object in the camera's frame."""
        return () if self.empty else self.item.placed(self.camera @ self.world)

    def facing(self, rng: np.random.Generator, spread: float) -> 'Frame':
        """Axes whose y leads away from the camera, within an angle [rad]; the world's z is up."""
        turn = random_heading(rng, self.camera, spread) - np.pi / 2
        return Frame(self.camera @ pose_of(Rotation.from_euler('z', turn), np.zeros(3)))


@dataclass(frozen=True)
class Furnished:
    """What there is at a place.

    target: the object's solids as they are there. solids, sheets: all else, camera's frame.
    """

    target: tuple[Solid, ...]
    solids: tuple[Solid, ...]
    sheets: tuple[Sheet, ...]


@dataclass(frozen=True)
class Frame:
    """Where furniture is built. pose: (4, 4), frame to camera."""

    pose: Pose

    def box(self, low: NDArray[np.floating], high: NDArray[np.floating], medium: Medium) -> Solid:
        """A block between two corners (3,) [m]."""
        middle = (np.asarray(low) + high) / 2
        triangles = trimesh.creation.box(np.asarray(high) - low).triangles
        return Solid(Triangles(np.array(triangles), 0, 1), (medium,),
                     self.pose @ pose_of(Rotation.identity(), middle))

    def solid(self, solid: Solid) -> Solid:
        """A solid, placed."""
        return replace(solid, pose=self.pose @ solid.pose)

    def level(self, low: tuple[float, float], high: tuple[float, float], z: float,
              texture: Texture, side: float, coat: float = 1.0, roughness: float = 0.0) -> Sheet:
        """A sheet at height z between two corners (x, y) [m]."""
        (x0, y0), (x1, y1) = low, high
        middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, z])
        return Sheet(self.pose @ pose_of(Rotation.identity(), middle), (x1 - x0, y1 - y0), texture,
                     side, 1.0, coat, roughness)

    def across_y(self, x: tuple[float, float], y: float, z: tuple[float, float], texture: Texture,
                 side: float, coat: float = 1.0, roughness: float = 0.0) -> Sheet:
        """A standing sheet at y, between limits of x and z [m]."""
        return self._standing(_WALL, np.array([sum(x) / 2, y, sum(z) / 2]),
                              (x[1] - x[0], z[1] - z[0]), texture, side, coat, roughness)

    def across_x(self, x: float, y: tuple[float, float], z: tuple[float, float], texture: Texture,
                 side: float, coat: float = 1.0, roughness: float = 0.0) -> Sheet:
        """A standing sheet at x, between limits of y and z [m]."""
        return self._standing(Rotation.from_euler('z', np.pi / 2) * _WALL,
                              np.array([x, sum(y) / 2, sum(z) / 2]),
                              (y[1] - y[0], z[1] - z[0]), texture, side, coat, roughness)

    def _standing(self, turn: Rotation, middle: NDArray[np.floating], size: tuple[float, float],
                  texture: Texture, side: float, coat: float, roughness: float) -> Sheet:
        return Sheet(self.pose @ pose_of(turn, middle), size, texture, side, 1.0, coat, roughness)
