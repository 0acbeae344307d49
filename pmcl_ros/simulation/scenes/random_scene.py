"""Draws scenes of one kind at random: objects, clutter, room, light and camera."""

from collections.abc import Sequence
from itertools import chain
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.light_field import ViewGrid
from pmcl_ros.runtime.settings import Odd, Settings
from pmcl_ros.simulation.scenes.environment import random_environment
from pmcl_ros.simulation.scenes.objects import (
    Finish,
    SceneObject,
    random_box,
    random_opaque,
    random_transparent,
)
from pmcl_ros.simulation.scenes.poses import (
    Pose,
    camera_above,
    random_heading,
    resting,
    standing_across,
    viewing_way,
)
from pmcl_ros.simulation.scenes.scene import Scene, Sheet, Solid, Target
from pmcl_ros.simulation.scenes.sensor import Sensor, pupil_views
from pmcl_ros.simulation.scenes.shapes.blocks import random_block
from pmcl_ros.simulation.scenes.shapes.handles import random_handled
from pmcl_ros.simulation.scenes.textures import random_texture

Kind = Literal['glass', 'opaque', 'glass film', 'opaque film', 'glass block', 'opaque block',
               'glass block film', 'opaque block film', 'glass handle', 'opaque handle',
               'glass handle film', 'opaque handle film']
KINDS: tuple[Kind, ...] = get_args(Kind)
_TABLE = 3.0  # m
# An F01 at ISO 80 in a lit room, from flat parts of decoded views: of a value v of green the
# standard deviation is 0.016 at 0.45 and 0.009 at 0.15.
_SHOT, _READ = 5.5e-4, 0.002
_TRIES = 50  # to find a spot; clutter without one is left out, targets go farther apart


class SceneSettings(Settings):
    """Parameters of `random_scene`."""

    kinds: tuple[Kind, ...] = Field(
        ('glass', 'glass', 'opaque', 'glass film', 'opaque film', 'opaque film'), min_length=1,
        description='kinds of scenes, one of which is drawn: glass or opaque, vessels, '
        'blocks with sharp edges or vessels with handles, with or without a translucent film '
        'before everything')
    empty: float = Field(0.1, ge=0, le=1, description='share of scenes without their object')
    targets: int = Field(1, ge=1, le=8, description='objects to look for in a scene')
    outside: float = Field(0.15, ge=0, le=1,
                           description='share of scenes whose object reaches beyond the image')
    aside: float = Field(0.6, ge=0, le=1, description='of broad scenes: how far from the middle '
                         'of the picture the object may be otherwise, in halves of its sides')
    clutter: int = Field(5, ge=0, le=20, description='other objects at most')
    near: float = Field(0.4, ge=0.15, le=5, description='least distance of the object [m]')
    far: float = Field(0.75, ge=0.15, le=5, description='largest distance of the object [m]')
    roi: float = Field(0.16, gt=0, le=2,
                       description="side of the box that holds the object's origin [m]")
    views: Odd = Field(7, ge=3, le=31, description='side of the square of views, odd [views]')
    size: int = Field(328, ge=16, le=2000, description='side of a view [px]')
    field: float = Field(0.347, gt=0.02, le=1.5,
                         description="field of view: the image's side over the focal length [1]; "
                         "the camera's own varies by a tenth about it")
    noise: float = Field(1.0, ge=0, le=20, description='noise: standard deviation in units of '
                         'that of an F01 at ISO 80 in a lit room; 0: none')


def random_scene(rng: np.random.Generator, settings: SceneSettings | None = None,
                 objects: tuple[SceneObject, ...] = (), sensor: Sensor | None = None) -> Scene:
    """Draw a scene: targets and clutter on a table, a wall, a room, a camera, maybe a film.

    objects: the targets; by default as many as the settings say, of the kind that is drawn.
    sensor: the camera; by default one like an F01 is drawn.
    """
    of = settings or SceneSettings()
    kind = of.kinds[int(rng.integers(len(of.kinds)))]
    objects = objects or tuple(random_object(rng, kind) for _ in range(of.targets))
    empty = bool(rng.random() < of.empty)
    spots = _spots(rng, objects, of.clutter)
    sensor = sensor or random_sensor(rng, of)
    worlds = [pose_of(Rotation.identity(), spot) @ each.at_rest(rng)
              for each, spot in zip(objects, spots, strict=False)]
    camera = _camera(rng, of, sensor.grid.pinhole, worlds)
    poses = [camera @ each for each in worlds]
    targets = tuple(random_target(rng, each, pose, of.roi, empty)
                    for each, pose in zip(objects, poses, strict=True))
    solids, owners = ([], []) if empty else placed(objects, poses)
    sheets = random_room(rng, camera)
    for spot in spots[len(objects):]:
        _add_clutter(rng, solids, sheets, camera @ pose_of(Rotation.identity(), spot))
    owners += [len(objects)] * (len(solids) - len(owners))
    if kind.endswith('film'):
        sheets.append(random_film(rng, nearest_depth(objects, poses)))
    name = f'{kind}: {objects[0].name}' + (', empty' if empty else '')
    return Scene(name, tuple(solids), tuple(sheets), random_environment(rng), camera[:3, :3].T,
                 sensor, targets, tuple(owners))


def placed(objects: Sequence[SceneObject], poses: Sequence[Pose]
           ) -> tuple[list[Solid], list[int]]:
    """The solids of objects at poses (4, 4), object to camera, and the index of each one's object.
    """
    solids = [each.placed(pose) for each, pose in zip(objects, poses, strict=True)]
    return [*chain(*solids)], [number for number, of in enumerate(solids) for _ in of]


def nearest_depth(objects: Sequence[SceneObject], poses: Sequence[Pose]) -> float:
    """The least depth of any vertex of objects at poses [m]."""
    return min(float((each.vertices @ pose[2, :3]).min() + pose[2, 3])
               for each, pose in zip(objects, poses, strict=True))


def random_object(rng: np.random.Generator, kind: Kind, finish: Finish | None = None,
                  walls: tuple[float, float] = (0.0012, 0.005)) -> SceneObject:
    """An object of a kind of scene.

    finish: draws what opaque ones are made of. walls: limits of those of glass vessels [m].
    """
    glass = kind.startswith('glass')
    if 'handle' in kind:
        return random_handled(rng, glass, finish)
    if 'block' in kind:
        return random_block(rng, glass, finish)
    return random_transparent(rng, walls) if glass else random_opaque(rng, finish)


def random_sensor(rng: np.random.Generator, of: SceneSettings) -> Sensor:
    """A camera like an F01, its focus, exposure and noise random."""
    focal = of.size / of.field * rng.uniform(0.9, 1.1)
    middle = (of.size - 1) / 2 + rng.uniform(-0.02, 0.02, 2) * of.size
    pinhole = Pinhole(of.size, of.size, focal, focal, *middle.tolist())
    radius = rng.uniform(3.9, 4.4) * max(1.0, of.views / 9)
    positions, weights = pupil_views(of.views, radius)
    grid = ViewGrid(pinhole, float(rng.uniform(0.0006, 0.0009)), positions, weights)
    red, blue = (float(each) for each in rng.uniform(0.75, 1.0, 2))
    strength = of.noise ** 2 * np.exp(rng.uniform(np.log(0.4), np.log(2)))
    return Sensor(grid, float(rng.uniform(0.4, 0.7)), radius, float(rng.uniform(0.8, 1.15)),
                  float(rng.uniform(0.2, 0.42)), float(_SHOT * strength),
                  float(_READ * np.sqrt(strength)), (red, 1.0, blue))


def _spots(rng: np.random.Generator, objects: tuple[SceneObject, ...], clutter: int
           ) -> list[NDArray[np.float64]]:
    """Places (3,) on the table [m], first those of objects, so far apart that nothing touches."""
    reach = [float(np.linalg.norm(each.vertices, axis=1).max()) for each in objects]
    count = int(rng.integers(clutter + 1)) if clutter else 0
    spots, radii = [np.zeros(3)], [reach[0]]
    for radius in (*reach[1:], *[0.12] * count):
        is_clutter = len(spots) >= len(objects)
        for attempt in range(_TRIES):
            spot = np.append(rng.normal(0, 0.18 if is_clutter else 0.07 * 1.05 ** attempt, 2), 0)
            if all(np.linalg.norm(spot - each) > radius + other
                   for each, other in zip(spots, radii, strict=True)):
                break
            rng.normal(size=2)  # not used: each seed keeps its scene
        else:
            continue
        spots.append(spot)
        radii.append(radius)
    return spots


def _camera(rng: np.random.Generator, of: SceneSettings, pinhole: Pinhole, worlds: list[Pose]
            ) -> Pose:
    aim = np.mean([each[:3, 3] for each in worlds], axis=0)
    spread = 0.5 * of.field if rng.random() < of.outside else 0.1 * of.field
    middle = np.array([pinhole.width - 1, pinhole.height - 1]) / 2
    centre = middle - [pinhole.cx, pinhole.cy]
    aside = np.arctan(centre / pinhole.fx) + spread * rng.uniform(-1, 1, 2)
    return camera_above(rng, aim, rng.uniform(of.near, of.far), (aside[0], aside[1]))


def random_target(rng: np.random.Generator, of: SceneObject, pose: Pose, side: float, empty: bool
                  ) -> Target:
    """An object at a pose, with a region of interest of a side [m] about it, up to 0.2 sides off.
    """
    off = 0.2 * side * rng.uniform(-1, 1, 3)
    return of.target(pose, pose[:3, 3] + off, np.full(3, side), empty)


def random_room(rng: np.random.Generator, camera: Pose) -> list[Sheet]:
    """The table, and a wall behind it."""
    turn = Rotation.from_euler('z', rng.uniform(0, 2 * np.pi))
    table = Sheet(camera @ pose_of(turn, np.zeros(3)), (_TABLE, _TABLE), random_texture(rng),
                  float(rng.uniform(0.2, 0.6)))
    upright = standing_across(random_heading(rng, camera, 0.5))
    middle = rng.uniform(0.14, 1.2) * np.append(viewing_way(camera), 0) + [0, 0, 0.75]
    wall = Sheet(camera @ pose_of(upright, middle), (_TABLE, 1.5), random_texture(rng),
                 float(rng.uniform(0.3, 1.0)))
    return [table, wall]


def _add_clutter(rng: np.random.Generator, solids: list[Solid], sheets: list[Sheet], place: Pose
                 ) -> None:
    draw = rng.random()
    if draw < 0.6:
        sides = random_box(rng)
        turned = place @ pose_of(Rotation.from_euler('z', rng.uniform(0, 7)), np.zeros(3))
        sheets += [Sheet(turned @ each.pose, each.size, each.texture, each.side)
                   for each in sides]
        return
    clutter = random_opaque(rng) if draw < 0.8 else random_transparent(rng)
    solids += clutter.placed(place @ resting(rng, clutter.vertices, 'upright'))


def random_film(rng: np.random.Generator, nearest: float) -> Sheet:
    """A translucent film between the camera and `nearest`, the least depth of the objects [m]."""
    turn = Rotation.from_rotvec(np.append(rng.normal(0, 0.12, 2), rng.uniform(0, 7)))
    depth = max(0.12, rng.uniform(0.55, 0.93) * nearest)
    texture = random_texture(rng, ('panes', 'panes', 'panes', 'clouds', 'lettering'))
    return Sheet(pose_of(turn, np.array([0, 0, depth])), (2.0, 2.0), texture,
                 float(rng.uniform(0.15, 0.5)), float(rng.uniform(0.12, 0.42)))
