"""Draws scenes of a given object in surroundings that users name."""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from pydantic import Field

from pmcl_ros.runtime.errors import SimulationError
from pmcl_ros.simulation.described.place import Furnished, Place
from pmcl_ros.simulation.described.ring_sheet import RingSheet
from pmcl_ros.simulation.described.wet_places import sink, tank
from pmcl_ros.simulation.scenes.broad_scene import (
    Palette,
    beside_each_other,
    broad_room,
    broad_scene,
    random_clutter,
    random_view,
)
from pmcl_ros.simulation.scenes.environment import random_lit_environment
from pmcl_ros.simulation.scenes.objects import SceneObject
from pmcl_ros.simulation.scenes.random_scene import Kind, SceneSettings, placed, random_target
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.sensor import Sensor

Surroundings = Literal['table', 'shelf', 'sink', 'tank', 'clutter', 'random']
SURROUNDINGS: tuple[Surroundings, ...] = get_args(Surroundings)
Attitude = Literal['any', 'upright', 'lying']
# Limits of the angle at which the camera looks down [rad].
_HEIGHTS = {'table': (0.08, 1.5), 'shelf': (0.0, 0.35), 'sink': (0.8, 1.45), 'tank': (0.0, 0.4),
            'clutter': (0.08, 1.5)}
_ABOVE_RING = 0.44, 0.87  # 25 to 50 degrees
WITH_RING: tuple[Surroundings, ...] = ('table', 'clutter')
_TRIES = 30  # scenes, until nothing hides the object
_SHOULDER = 0.7  # of the camera's distance: a board may come so near to it


class DescribedSettings(SceneSettings):
    """Parameters of `described_scene`; `kinds` with a film put one before random surroundings."""

    kinds: tuple[Kind, ...] = Field(('glass',), min_length=1, description='of random '
                                    'surroundings: with a film before everything or without')
    outside: float = Field(0.0, ge=0, le=1, description='share of scenes whose object may reach '
                           'beyond the image')
    aside: float = Field(0.25, ge=0, le=1, description='how far from the middle of the picture '
                         'the object may be, in halves of its sides')
    attitude: Attitude = Field('any', description='how the object rests: upright, lying, or any '
                               'way, held up too')


def described_scene(rng: np.random.Generator, item: SceneObject, surroundings: Surroundings,
                    sensor: Sensor, settings: DescribedSettings | None = None,
                    ring: RingSheet | None = None) -> Scene:
    """Draw a scene of an object, its one target, as a camera sees it, with lamps and shadows.

    surroundings: `table`: a table that may end in view, mostly a wall; `shelf`: boards below,
    above and behind; `sink`: as `wet_places.sink`; `tank`: as `wet_places.tank`; `clutter`: a
    table with things beside, before and behind; `random`: as `broad_scene`. One in which a counter
    or a wall hides the object's middle is drawn again. ring: around the object, in surroundings
    WITH_RING, seen from 25 to 50 degrees above the table. Raises SimulationError where the object
    may not rest as the settings say, or is always hidden.
    """
    of = settings or DescribedSettings()
    if of.attitude != 'any':
        if item.way not in ('', of.attitude):
            raise SimulationError(f'{item.name} holds a liquid: it stands upright, and cannot '
                                  f'rest {of.attitude}; set attitude: upright')
        item = replace(item, way=of.attitude)
    if surroundings == 'random':
        scene = broad_scene(rng, of, sensor, (item,))
        return replace(scene, name=f'random: {item.name}')
    for _ in range(_TRIES):
        scene = _drawn(rng, item, surroundings, sensor, of, ring)
        if not any(scene.hiding_sheets(np.zeros((1, 3)))):
            return scene
    raise SimulationError(f'{surroundings}: {item.name} was hidden in {_TRIES} scenes in a row; '
                          'choose other surroundings')


def _drawn(rng: np.random.Generator, item: SceneObject, surroundings: Surroundings,
           sensor: Sensor, of: DescribedSettings, ring: RingSheet | None) -> Scene:
    empty = bool(rng.random() < of.empty)
    (world,), circles = beside_each_other(rng, (item,))
    heights, lies = _HEIGHTS[surroundings], np.eye(4)
    if ring is not None:
        heights, lies = _ABOVE_RING, ring.around(rng, circles[0][1])
        circles.append((lies[:2, 3], ring.reach))
        world = ring.lifted(world)
    vertices = item.vertices @ world[:3, :3].T + world[:3, 3]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    camera = random_view(rng, of, sensor, (low + high) / 2, heights, 0.0, centred=True)
    pose = camera @ world
    place = Place(item, world, float(high[2]), camera, circles, Palette(rng), of.near, empty)
    around = _MAKERS[surroundings](rng, place, of)
    target = random_target(rng, item, pose, of.roi, empty)
    owners = (0,) * len(around.target) + (1,) * len(around.solids)
    scene = Scene(f'{surroundings}: {item.name}' + (', empty' if empty else ''),
                  around.target + around.solids, around.sheets, random_lit_environment(rng),
                  camera[:3, :3].T, sensor, (target,), owners)
    return scene if ring is None else ring.laid(scene, camera @ lies)


def _table(rng: np.random.Generator, place: Place, _: DescribedSettings) -> Furnished:
    return Furnished(place.target, (), tuple(broad_room(rng, place.camera, place.palette,
                                                          place.circles)))


def _clutter(rng: np.random.Generator, place: Place, of: DescribedSettings) -> Furnished:
    count = int(rng.integers(2, max(of.clutter, 2) + 1))
    clutter, poses = random_clutter(rng, count, place.palette, place.circles, place.camera)
    sheets = broad_room(rng, place.camera, place.palette, place.circles)
    return Furnished(place.target, tuple(placed(clutter, poses)[0]), tuple(sheets))


def _shelf(rng: np.random.Generator, place: Place, _: DescribedSettings) -> Furnished:
    """Boards in front of a wall; the object stands on one of them."""
    frame = place.facing(rng, 0.5)
    front = -min(place.reach + rng.uniform(0.02, 0.12), _SHOULDER * place.near)
    back = place.reach + rng.uniform(0.01, 0.2)
    left, right = -place.reach - rng.uniform(0.05, 0.5, 2) * [1, -1]
    right += 2 * place.reach
    thick = rng.uniform(0.012, 0.03)
    above = place.top + rng.uniform(0.04, 0.25)
    wood = place.palette.finish(rng)
    boards = [frame.box(np.array([left, front, z]), np.array([right, back, z + thick]), wood)
              for z in (-thick - 1e-5, above, -thick - above)]
    if rng.random() < 0.6:
        boards += [frame.box(np.array([x, front, -thick - above]),
                             np.array([x + thick, back, above + thick]), wood)
                   for x in (left - thick, right)]
    texture = place.palette.texture()
    wall = frame.across_y((-3, 3), back + 1e-3, (-1.5, 1.5), texture,
                          float(np.exp(rng.uniform(np.log(0.2), np.log(2.0)))))
    return Furnished(place.target, tuple(boards), (wall,))


_MAKERS: dict[Surroundings, Callable[[np.random.Generator, Place, DescribedSettings], Furnished]]
_MAKERS = {'table': _table, 'shelf': _shelf, 'clutter': _clutter,
           'sink': lambda rng, place, _: sink(rng, place),
           'tank': lambda rng, place, _: tank(rng, place)}
