"""What a camera sees of a workplace: the scene that the renderers take."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.simulation.described.place import Frame
from pmcl_ros.simulation.described.substances import WATER
from pmcl_ros.simulation.described.water import (
    can_stand_in_water,
    standing_in_water,
    water_surface,
)
from pmcl_ros.simulation.described.wet_places import (
    BEYOND,
    GAP,
    basin,
    random_finish,
    running_water,
)
from pmcl_ros.simulation.manipulation.workplace import Box, Workplace
from pmcl_ros.simulation.scenes.broad_scene import Palette
from pmcl_ros.simulation.scenes.environment import random_lit_environment
from pmcl_ros.simulation.scenes.materials import Opaque
from pmcl_ros.simulation.scenes.objects import SceneObject
from pmcl_ros.simulation.scenes.poses import Pose
from pmcl_ros.simulation.scenes.random_scene import random_film
from pmcl_ros.simulation.scenes.scene import Scene, Sheet, Solid
from pmcl_ros.simulation.scenes.sensor import Sensor

_AHEAD = Rotation.from_euler('z', -np.pi / 2)  # of a frame whose y leads away from the robot
_UPRIGHT = np.cos(np.deg2rad(2.0))  # an object that leans more does not stand


@dataclass(frozen=True)
class WorkplaceLook:
    """How one workplace looks: finishes, light and film are the same in all pictures.

    seed: of all that. object: in it. Running water has other waves in each picture, standing
    water the same in all of them. That of a tank is without waves, and its panes are left out.
    """

    place: Workplace
    object: SceneObject
    seed: int

    def scene(self, camera: Pose, pose: Pose, sensor: Sensor, number: int) -> Scene:
        """The scene of picture `number`.

        camera: (4, 4), camera to base. pose: (4, 4), object to base. Its one target has a region
        of the object's size. An object that neither stands upright nor lies above the water is
        shown in an empty basin: a solid's media nest within that solid only.
        """
        rng = np.random.default_rng(self.seed)
        palette, metal, light = Palette(rng), random_finish(rng), random_lit_environment(rng)
        to_camera: Pose = inverse(camera)
        waves = np.random.default_rng([self.seed, number if self.place.jet else 0])
        make = self._sink if self.place.kind == 'sink' else self._tank
        target, solids, sheets = make(rng, waves, to_camera, pose, palette, metal)
        inside = to_camera @ pose
        middle = inside[:3, :3] @ np.mean([self.object.vertices.max(axis=0),
                                           self.object.vertices.min(axis=0)], axis=0)
        side = np.ptp(self.object.vertices, axis=0).max()
        seen = self.object.target(inside, inside[:3, 3] + middle, np.full(3, side))
        return Scene(f'{self.place.kind}: {self.object.name}', (*target, *solids), tuple(sheets),
                     light, camera[:3, :3], sensor, (seen,),
                     (0,) * len(target) + (1,) * len(solids))

    def _sink(self, rng: np.random.Generator, waves: np.random.Generator, to_camera: Pose,
              pose: Pose, palette: Palette, metal: Opaque
              ) -> tuple[tuple[Solid, ...], list[Solid], list[Sheet]]:
        place = self.place
        frame, low, high = _frame(place, to_camera, pose[:3, 3])
        sheets = basin(frame, low, high, (place.floor, place.rim), metal, palette)
        slope = float(rng.uniform(0.04, 0.15) if place.jet else rng.uniform(0.003, 0.03))
        target = self.object.placed(to_camera @ pose)
        lowest = float((self.object.vertices @ pose[2, :3]).min() + pose[2, 3])
        stands = pose[2, :3] @ self.object.up > _UPRIGHT
        hole, is_wet = 0.0, lowest > place.level
        if not is_wet and stands and can_stand_in_water(self.object):
            wet, hole = standing_in_water(self.object.solids[0], place.level - pose[2, 3])
            target = replace(self.object, solids=(wet,)).placed(to_camera @ pose)
            is_wet = True
        solids = self._furniture(palette, rng, metal, to_camera)
        if not is_wet:
            return target, solids, sheets
        jet = None
        if place.jet is not None:
            jet = _AHEAD.inv().apply([*(np.array(place.jet) - pose[:2, 3]), 0])[:2]
            solids += running_water(waves, frame, jet, rng.uniform(0.003, 0.007),
                                    (place.level, place.rim + 0.1), high[1] + 0.1, metal)
        solids.append(frame.solid(water_surface(waves, low - BEYOND, high + BEYOND, place.level,
                                                slope, hole, jet)))
        return target, solids, sheets

    def _tank(self, rng: np.random.Generator, _: np.random.Generator, to_camera: Pose,
              pose: Pose, palette: Palette, metal: Opaque
              ) -> tuple[tuple[Solid, ...], list[Solid], list[Sheet]]:
        place = self.place
        middle = np.mean([place.low, place.high], axis=0)
        frame, low, high = _frame(place, to_camera, middle)
        water = frame.box(np.array([*low, place.floor + GAP]), np.array([*high, place.level]),
                          WATER)
        film = random_film(rng, 1.0)
        front = frame.across_y((low[0], high[0]), low[1] - BEYOND, (place.floor, place.rim),
                               film.texture, film.side)
        sheets = [replace(front, opacity=film.opacity),
                  frame.level((-2, -2), (2, 2), place.floor, palette.texture(), 0.4),
                  frame.across_y((-2, 2), high[1] + 0.3, (place.floor, place.floor + 1.5),
                                 palette.texture(), 0.6)]
        solids = [water, *self._furniture(palette, rng, metal, to_camera)]
        return self.object.placed(to_camera @ pose), solids, sheets

    def _furniture(self, palette: Palette, rng: np.random.Generator, metal: Opaque,
                   to_camera: Pose) -> list[Solid]:
        """The tray, and the ledge if there is one."""
        base, finish = Frame(to_camera), palette.finish(rng)
        tray = next(each for each in self.place.boxes if each.name == 'tray')
        return [_block(base, tray, finish),
                *([] if self.place.ledge is None else [_block(base, self.place.ledge, metal)])]


def _block(base: Frame, box: Box, finish: Opaque) -> Solid:
    return base.box(np.array(box.low), np.array(box.high), finish)


def _frame(place: Workplace, to_camera: Pose, spot: NDArray[np.float64]
           ) -> tuple[Frame, NDArray[np.float64], NDArray[np.float64]]:
    """A frame above a spot, heights as in the base frame, y away from the robot; the basin's
    corners in it.
    """
    frame = Frame(to_camera @ pose_of(_AHEAD, np.array([spot[0], spot[1], 0.0])))
    (x0, y0), (x1, y1) = place.low, place.high
    return (frame, np.array([spot[1] - y1, x0 - spot[0]]), np.array([spot[1] - y0, x1 - spot[0]]))
