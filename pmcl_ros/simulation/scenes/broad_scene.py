"""Draws scenes of great variety: any camera, surroundings, clutter and material."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.simulation.scenes.environment import random_lit_environment
from pmcl_ros.simulation.scenes.materials import Clear, Opaque, random_glass
from pmcl_ros.simulation.scenes.objects import (
    Circle,
    Finish,
    SceneObject,
    random_opaque,
    random_transparent,
)
from pmcl_ros.simulation.scenes.poses import (
    Pose,
    camera_above,
    random_heading,
    standing_across,
    viewing_way,
)
from pmcl_ros.simulation.scenes.random_scene import (
    SceneSettings,
    nearest_depth,
    placed,
    random_film,
    random_object,
    random_sensor,
    random_target,
)
from pmcl_ros.simulation.scenes.scene import Decal, Scene, Sheet, Solid
from pmcl_ros.simulation.scenes.sensor import Sensor
from pmcl_ros.simulation.scenes.shapes.blocks import random_block
from pmcl_ros.simulation.scenes.shapes.handles import random_handled
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.vessels import outer_mesh
from pmcl_ros.simulation.scenes.textures import SIZE, Texture, random_texture

_PLAIN = 0.4  # share of surroundings of one colour without any texture
_TEXTURES = ('clouds', 'clouds', 'grain', 'planks', 'weave', 'leaves', 'leaves', 'lettering',
             'checks', 'panes', 'plain')
_WALLS = 0.0007, 0.008  # m
_LIDS = 0.15  # share of vessels in the clutter
_ROLLED = 0.15  # share of cameras that are turned any way about their axis


class Palette:
    """The textures of one scene: few, tinted and scaled in many ways."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._known = [random_texture(rng, _TEXTURES) for _ in range(int(rng.integers(2, 5)))]

    def texture(self) -> Texture:
        """One colour, often pale, or a pattern in a tint."""
        rng = self._rng
        if rng.random() < _PLAIN:
            return _of_one_colour(rng)
        known = self._known[int(rng.integers(len(self._known)))]
        tint = np.exp(rng.normal(0, 0.25) + rng.normal(0, 0.06, 3)).astype(np.float32)
        return np.minimum(known * tint, np.float32(0.95))

    def finish(self, rng: np.random.Generator) -> Opaque:
        """Matt or glossy, as `Finish`."""
        side = float(np.exp(rng.uniform(np.log(0.04), np.log(0.5))))
        return Opaque(self.texture(), side, *random_gloss(rng, 0.5))


def random_gloss(rng: np.random.Generator, share: float) -> tuple[float, float]:
    """Index and roughness of a coat, which a share of all things has."""
    if rng.random() > share:
        return 1.0, 0.0
    return float(rng.uniform(1.25, 1.7)), float(rng.choice([0.0, rng.uniform(0.01, 0.25)]))


def _of_one_colour(rng: np.random.Generator) -> Texture:
    tone = rng.uniform(0.55, 0.92) if rng.random() < 0.6 else rng.uniform(0.03, 0.55)
    colour = np.clip(tone * (1 + rng.choice([0.02, 0.08, 0.3]) * rng.standard_normal(3)),
                     0.02, 0.95)
    return np.broadcast_to(colour.astype(np.float32), (SIZE, SIZE, 3))


def broad_scene(rng: np.random.Generator, settings: SceneSettings,
                sensor: Sensor | None = None, objects: tuple[SceneObject, ...] = ()) -> Scene:
    """Draw a scene as `random_scene`, from broad distributions.

    sensor: the camera; default: like an F01. objects: the targets. Clutter stands beside, behind
    and before them; all of it is solid. The table may end in view.
    """
    kind = settings.kinds[int(rng.integers(len(settings.kinds)))]
    palette = Palette(rng)
    objects = objects or tuple(
        _worn(rng, random_object(rng, kind, palette.finish, _WALLS), palette)
        for _ in range(settings.targets))
    empty = bool(rng.random() < settings.empty)
    sensor = sensor or random_sensor(rng, settings)
    worlds, circles = beside_each_other(rng, objects)
    camera = random_view(rng, settings, sensor, np.mean([each[:3, 3] for each in worlds], axis=0))
    poses = [camera @ each for each in worlds]
    targets = tuple(random_target(rng, each, pose, settings.roi, empty)
                    for each, pose in zip(objects, poses, strict=True))
    items, places = random_clutter(rng, int(rng.integers(settings.clutter + 1)), palette, circles,
                                   camera)
    if not empty:
        items, places = [*objects, *items], [*poses, *places]
    solids, owners = placed(items, places)
    if empty:
        owners = [len(objects)] * len(owners)
    sheets = broad_room(rng, camera, palette, circles)
    if kind.endswith('film'):
        sheets.append(_film(rng, nearest_depth(objects, poses)))
    name = f'{kind}: {objects[0].name}' + (', empty' if empty else '')
    return Scene(name, tuple(solids), tuple(sheets), random_lit_environment(rng), camera[:3, :3].T,
                 sensor, targets, tuple(min(each, len(objects)) for each in owners))


def beside_each_other(rng: np.random.Generator, objects: tuple[SceneObject, ...]
                       ) -> tuple[list[Pose], list[Circle]]:
    """Poses (4, 4), object to world, of the targets, and their footprints."""
    worlds: list[Pose] = []
    circles: list[Circle] = []
    for each in objects:
        rest = each.at_rest(rng)
        middle, radius = each.footprint(rest)
        spot = np.zeros(2)
        while any(np.linalg.norm(spot - other) < radius + reach for other, reach in circles):
            spot = spot + rng.normal(0, 0.05, 2)
        circles.append((spot, radius))
        worlds.append(pose_of(Rotation.identity(), np.append(spot - middle, 0)) @ rest)
    return worlds, circles


def random_view(rng: np.random.Generator, of: SceneSettings, sensor: Sensor,
                aim: NDArray[np.float64], heights: tuple[float, float] = (0.08, 1.5),
                rolled: float = _ROLLED, centred: bool = False) -> Pose:
    """A camera (4, 4), world to camera, that has a point (3,) of the world [m] mostly in view.

    heights: limits of the angle at which it looks down [rad]; default: from nearly level to right
    from above. rolled: share of cameras that are turned any way about their axis. centred: the
    point is about the middle of the picture, not about the optical axis.
    """
    pinhole = sensor.grid.pinhole
    focal, size = np.array([pinhole.fx, pinhole.fy]), np.array([pinhole.width, pinhole.height])
    middle = ((size - 1) / 2 - [pinhole.cx, pinhole.cy]) / focal if centred else 0.0
    spread = (1.0 if rng.random() < of.outside else of.aside) * (size / focal / 2)
    aside = np.arctan(middle + spread * rng.uniform(-1, 1, 2))
    roll = np.pi if rng.random() < rolled else 0.08
    return camera_above(rng, aim, rng.uniform(of.near, of.far), (aside[0], aside[1]),
                        heights, roll)


def _ball(rng: np.random.Generator, finish: Finish) -> SceneObject:
    """Massive, of glass or opaque."""
    mesh = trimesh.creation.icosphere(3, rng.uniform(0.01, 0.04))
    radius, turn = mesh.extents[2] / 2, np.linspace(-np.pi / 2, np.pi / 2, 60)
    profile = radius * np.stack([np.abs(np.cos(turn)), np.sin(turn)], axis=1)
    medium = random_glass(rng) if rng.random() < 0.4 else finish(rng)
    return SceneObject('ball', (Solid(Frusta.from_profile(profile, 0, 1), (medium,), np.eye(4)),),
                       np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64), None)


def _worn(rng: np.random.Generator, item: SceneObject, palette: Palette) -> SceneObject:
    """At times frosted, with a label, with stains; of opaque items nothing changes."""
    first = item.solids[0]
    glass = first.media[0]
    if not isinstance(glass, Clear):
        return item
    draw = rng.random()
    if draw < 0.1:
        rough = float(np.exp(rng.uniform(np.log(0.02), np.log(0.35))))
        first = replace(first, media=(replace(glass, roughness=rough), *first.media[1:]))
    low, high = item.vertices[:, 2].min(), item.vertices[:, 2].max()
    if 0.05 < draw < 0.2:
        size = rng.uniform(0.15, 0.7) * (high - low)
        start, turn = rng.uniform(low, high - size), rng.uniform(-np.pi, np.pi)
        label = palette.texture() if rng.random() < 0.5 else random_texture(rng, ('lettering',))
        opacity = 1.0 if rng.random() < 0.7 else float(rng.uniform(0.2, 0.8))
        first = replace(first, decal=Decal(
            (float(start), float(start + size)), (turn, turn + float(rng.uniform(0.6, 5))),
            label, float(rng.uniform(0.05, 0.2)), opacity))
    elif 0.2 < draw < 0.32:
        first = replace(first, decal=Decal(
            (float(low), float(high)), (-np.pi, np.pi), random_texture(rng, ('clouds',)),
            float(rng.uniform(0.05, 0.3)), float(rng.uniform(0.05, 0.5)),
            float(rng.uniform(0.15, 0.6))))
    return replace(item, solids=(first, *item.solids[1:]))


def _lidded(rng: np.random.Generator, item: SceneObject, finish: Finish) -> SceneObject:
    """A lid or cap, opaque, on a vessel; its outline is the item's too."""
    high = item.vertices[:, 2].max()
    rim = np.linalg.norm(item.vertices[item.vertices[:, 2] > high - 0.004, :2], axis=1).max()
    radius, down, up = rim * rng.uniform(1.02, 1.12), rng.uniform(0.002, 0.012), \
        rng.uniform(0.001, 0.012)
    profile = np.array([[0, high - down], [radius, high - down], [radius, high + up],
                        [0, high + up]])
    cap = Solid(Frusta.from_profile(profile, 0, 1), (finish(rng),), np.eye(4))
    vertices, faces = outer_mesh(profile)
    return replace(item, solids=(*item.solids, cap),
                   vertices=np.concatenate([item.vertices, vertices]),
                   faces=np.concatenate([item.faces, faces + len(item.vertices)]))


def random_clutter(rng: np.random.Generator, count: int, palette: Palette, circles: list[Circle],
                   camera: Pose) -> tuple[list[SceneObject], list[Pose]]:
    """Up to `count` items on the table, and their poses (4, 4), object to camera.

    circles: footprints of what is there; theirs are appended.
    """
    items, places = [], []
    for _ in range(count):
        item = _worn(rng, _clutter(rng, palette.finish), palette)
        if item.axis is not None and rng.random() < _LIDS:
            item = _lidded(rng, item, palette.finish)
        rest = item.at_rest(rng)
        spot = _spot(rng, item, rest, circles, camera)
        if spot is not None:
            items.append(item)
            places.append(camera @ pose_of(Rotation.identity(), spot) @ rest)
    return items, places


def _clutter(rng: np.random.Generator, finish: Finish) -> SceneObject:
    makers: tuple[tuple[float, Callable[[], SceneObject]], ...] = (
        (0.28, lambda: random_transparent(rng, _WALLS)),
        (0.14, lambda: random_opaque(rng, finish)),
        (0.1, lambda: random_block(rng, bool(rng.random() < 0.6), finish)),
        (0.1, lambda: random_handled(rng, bool(rng.random() < 0.6), finish)),
        (0.2, lambda: SceneObject.from_mesh(trimesh.creation.box(
            np.exp(rng.uniform(np.log(0.01), np.log(0.2), 3))), finish(rng), 'box')),
        (0.1, lambda: SceneObject.from_mesh(trimesh.creation.cylinder(
            rng.uniform(0.002, 0.012), rng.uniform(0.05, 0.2), sections=48), finish(rng), 'rod')),
        (0.08, lambda: _ball(rng, finish)))
    shares = np.array([share for share, _ in makers])
    return makers[int(rng.choice(len(makers), p=shares / shares.sum()))][1]()


def _spot(rng: np.random.Generator, item: SceneObject, rest: Pose, circles: list[Circle],
          camera: Pose) -> NDArray[np.float64] | None:
    """A free place (3,) on the table [m]: beside what is there, behind it, or anywhere.

    Its footprint is appended to `circles`. None where no place is found, or where it would be
    nearer than 10 cm to the camera.
    """
    middle, radius = item.footprint(rest)
    ahead = viewing_way(camera)
    eye = -camera[:3, :3].T @ camera[:3, 3]
    for _ in range(30):
        at, reach = circles[int(rng.integers(len(circles)))]
        draw = rng.random()
        if draw < 0.4:
            turn = rng.uniform(0, 2 * np.pi)
            way = np.array([np.cos(turn), np.sin(turn)])
            spot = at + (reach + radius + np.exp(rng.uniform(-6.5, -3))) * way
        elif draw < 0.7:
            spot = at + rng.uniform(0.05, 0.6) * ahead + rng.normal(0, 0.04, 2)
        elif draw < 0.78:
            spot = at - rng.uniform(0.05, 0.2) * ahead + rng.normal(0, 0.05, 2)
        else:
            spot = rng.normal(0, 0.25, 2)
        clear = np.linalg.norm(np.append(spot, 0.05) - eye) > radius + 0.15
        if clear and all(np.linalg.norm(spot - other) > radius + size + 0.001
                         for other, size in circles):
            circles.append((spot, radius))
            return np.append(spot - middle, 0)
    return None


def _film(rng: np.random.Generator, nearest: float) -> Sheet:
    """As `random_film`, or of one colour; a third of them scatters light."""
    film = random_film(rng, nearest)
    if rng.random() < 0.3:
        film = replace(film, texture=_of_one_colour(rng))
    if rng.random() < 0.35:
        film = replace(film, roughness=float(np.exp(rng.uniform(np.log(0.001), np.log(0.02)))))
    return film


def broad_room(rng: np.random.Generator, camera: Pose, palette: Palette, circles: list[Circle]
          ) -> list[Sheet]:
    """A table, which may end in view above a floor, and mostly a wall behind it."""
    turn = rng.uniform(0, 2 * np.pi)
    rotation = Rotation.from_euler('z', turn)
    sheets = []
    if rng.random() < 0.5:
        size, middle = np.full(2, 4.0), np.zeros(2)
    else:
        footing = rotation.inv().apply([[*at, 0] for at, _ in circles])[:, :2]
        reach = np.array([[radius] for _, radius in circles])
        margins = np.exp(rng.uniform(np.log(0.03), np.log(1.2), (2, 2)))
        low = (footing - reach).min(axis=0) - margins[0]
        high = (footing + reach).max(axis=0) + margins[1]
        size, middle = high - low, (low + high) / 2
        floor = np.array([0, 0, -rng.uniform(0.3, 0.9)])
        sheets.append(Sheet(camera @ pose_of(rotation, floor), (8.0, 8.0), palette.texture(),
                            float(rng.uniform(0.3, 2.0))))
        edge = rng.uniform(0.015, 0.05)
        texture = palette.texture()
        for axis in range(2):
            for sign in (-1, 1):
                aside = np.zeros(3)
                aside[axis] = sign * size[axis] / 2
                place = rotation.apply(np.append(middle, -edge / 2) + aside)
                tilt = Rotation.from_euler('x', np.pi / 2)
                upright = rotation * (Rotation.from_euler('z', np.pi / 2) if axis == 0
                                      else Rotation.identity()) * tilt
                sheets.append(Sheet(camera @ pose_of(upright, place), (size[1 - axis], edge),
                                    texture, float(rng.uniform(0.2, 0.6))))
    place = np.append(middle, 0)
    sheets.append(Sheet(camera @ pose_of(rotation, rotation.apply(place)),
                        (float(size[0]), float(size[1])), palette.texture(),
                        float(np.exp(rng.uniform(np.log(0.1), np.log(1.0)))), 1.0,
                        *random_gloss(rng, 0.45)))
    if rng.random() < 0.65:
        sheets.append(_wall(rng, camera, palette, circles))
    return sheets


def _wall(rng: np.random.Generator, camera: Pose, palette: Palette, circles: list[Circle]
          ) -> Sheet:
    """Upright, behind everything on the table."""
    heading = random_heading(rng, camera, 0.6)
    way = np.array([np.cos(heading), np.sin(heading)])
    behind = max(float(at @ way) + radius for at, radius in circles)
    away = behind + np.exp(rng.uniform(np.log(0.02), np.log(2.0)))
    return Sheet(camera @ pose_of(standing_across(heading), np.append(away * way, 0.5)),
                 (8.0, 3.0), palette.texture(),
                 float(np.exp(rng.uniform(np.log(0.2), np.log(2.0)))))
