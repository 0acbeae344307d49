"""Draws scenes of several objects close together, some in front of others."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.simulation.scenes.environment import random_environment
from pmcl_ros.simulation.scenes.objects import (
    Circle,
    SceneObject,
    random_opaque,
    random_transparent,
)
from pmcl_ros.simulation.scenes.poses import Pose, camera_above
from pmcl_ros.simulation.scenes.random_scene import (
    SceneSettings,
    nearest_depth,
    placed,
    random_film,
    random_room,
    random_sensor,
)
from pmcl_ros.simulation.scenes.scene import Scene, Target
from pmcl_ros.simulation.scenes.sensor import Sensor

_TRIES = 2000  # until objects overlap in view
_GLASS, _COPY, _FILM = 0.6, 0.25, 0.2  # shares: of objects, of scenes with copies, with a film
_GAP = 0.005, 0.05  # m between two neighbours
_OVERLAP, _MOST_OVERLAP = 0.1, 0.6  # of the smaller outline: at least in one pair, at most in all
_MARGIN = 3  # px: distance of all objects from the image's border


@dataclass(frozen=True)
class GroupScene:
    """A scene, and for each of its targets the index of the target that it is a copy of, or its
    own.
    """

    scene: Scene
    copies: tuple[int, ...]


def group_scene(rng: np.random.Generator, count: int, settings: SceneSettings,
                sensor: Sensor | None = None) -> GroupScene:
    """Draw `count` objects of glass or opaque ones close together on a table, all of them in view.

    At least two of them overlap in the image, each pair by 60 % of the smaller outline at most.
    All targets have one region of interest: it holds their origins with a margin of 3 to 6 cm.
    sensor: the camera; by default one like an F01 is drawn.
    """
    copies = list(range(count))
    if count > 1 and rng.random() < _COPY:
        copies[1] = 0
    made = [random_transparent(rng) if rng.random() < _GLASS else random_opaque(rng)
            for _ in range(count)]
    objects = [made[k] for k in copies]
    sensor = sensor or random_sensor(rng, settings)
    pinhole = sensor.grid.pinhole
    for _ in range(_TRIES):
        worlds = _beside_each_other(rng, objects)
        aim = np.mean([each[:3, 3] for each in worlds], axis=0)
        camera = camera_above(rng, aim, rng.uniform(settings.near, settings.far), (0.0, 0.0))
        poses = [camera @ each for each in worlds]
        if _overlapping([_outline(each.vertices, pose, pinhole)
                         for each, pose in zip(objects, poses, strict=True)], pinhole):
            break
    else:
        raise RuntimeError(f'{count} objects never overlapped in view in {_TRIES} tries')
    solids, owners = placed(objects, poses)
    sheets = random_room(rng, camera)
    if rng.random() < _FILM:
        sheets.append(random_film(rng, nearest_depth(objects, poses)))
    origins = np.array([each[:3, 3] for each in poses])
    low = origins.min(axis=0) - rng.uniform(0.03, 0.06, 3)
    high = origins.max(axis=0) + rng.uniform(0.03, 0.06, 3)
    targets = tuple(each.target(pose, (low + high) / 2, high - low)
                    for each, pose in zip(objects, poses, strict=True))
    scene = Scene(', '.join(each.name for each in objects), tuple(solids), tuple(sheets),
                  random_environment(rng), camera[:3, :3].T, sensor, targets, tuple(owners))
    return GroupScene(scene, tuple(copies))


def _beside_each_other(rng: np.random.Generator, objects: Sequence[SceneObject]) -> list[Pose]:
    """Poses (4, 4), object to world: each beside an earlier one, their footprints apart."""
    worlds: list[Pose] = []
    circles: list[Circle] = []
    for each in objects:
        rest = each.at_rest(rng)
        middle, radius = each.footprint(rest)
        spot = np.zeros(2)
        while any(np.linalg.norm(spot - other) < radius + reach + _GAP[0]
                  for other, reach in circles):
            beside, reach = circles[int(rng.integers(len(circles)))]
            angle = rng.uniform(0, 2 * np.pi)
            spot = beside + (radius + reach + rng.uniform(*_GAP)) * np.array(
                [np.cos(angle), np.sin(angle)])
        circles.append((spot, radius))
        worlds.append(pose_of(Rotation.identity(), np.append(spot - middle, 0)) @ rest)
    return worlds


def _outline(vertices: NDArray[np.float64], pose: Pose, pinhole: Pinhole) -> NDArray[np.float32]:
    """(n, 2) corners of the convex hull of an object in the image [px]."""
    pixels = pinhole.project(vertices @ pose[:3, :3].T + pose[:3, 3])
    return np.asarray(cv2.convexHull(pixels.astype(np.float32))[:, 0], np.float32)


def _common(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Area that two outlines share, over that of the smaller one."""
    common = float(cv2.intersectConvexConvex(one, other)[0])
    return common / min(cv2.contourArea(one), cv2.contourArea(other))


def _overlapping(outlines: list[NDArray[np.float32]], pinhole: Pinhole) -> bool:
    corner = np.array([pinhole.width, pinhole.height]) - 1 - _MARGIN
    if any((each < _MARGIN).any() or (each > corner).any() for each in outlines):
        return False
    shares = [_common(one, other) for one, other in combinations(outlines, 2)]
    return _OVERLAP <= max(shares, default=_OVERLAP) <= _MOST_OVERLAP


def seen_overlap(targets: Sequence[Target], pinhole: Pinhole) -> float:
    """The largest area that two convex outlines share, over that of the smaller one: 0 to 1."""
    outlines = [_outline(each.vertices, each.pose, pinhole) for each in targets]
    return max((_common(one, other) for one, other in combinations(outlines, 2)), default=0.0)
