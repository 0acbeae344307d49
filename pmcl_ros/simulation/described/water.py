"""Water around objects: its surface with waves, a jet, and what stands in it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.simulation.described.substances import WATER
from pmcl_ros.simulation.scenes.objects import SceneObject
from pmcl_ros.simulation.scenes.scene import Solid
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles

_WAVES = 14  # plane waves that a surface is the sum of
_LENGTHS = 0.02, 0.06  # m: of waves
_CALM = 0.012  # m: waves end so far from what stands in the water
_AROUND, _OUT = 160, 48  # points of a water surface
_RINGS = 90  # of a jet


def submerged(solid: Solid) -> Solid:
    """A solid with water all around it, as another medium of its own."""
    water = len(solid.media) + 1
    surface = solid.surface
    if isinstance(surface, Frusta):
        surface = replace(surface, media=np.where(surface.media == 0, water, surface.media))
    else:
        surface = replace(surface, outside=surface.outside or water,
                          inside=surface.inside or water)
    return replace(solid, surface=surface, media=(*solid.media, WATER))


def can_stand_in_water(item: SceneObject) -> bool:
    """Whether water may reach up to any part of it while it stands: a body of revolution."""
    return len(item.solids) == 1 and isinstance(item.solids[0].surface, Frusta)


def standing_in_water(solid: Solid, level: float) -> tuple[Solid, float]:
    """A vessel with water outside of it up to a height, dry inside, and its radius there [m].

    solid: of `Frusta`, rings of the outer surface first, from the bottom to the rim. level: z in
    its frame [m], below the rim; else the water would run in.
    """
    surface = solid.surface
    if not isinstance(surface, Frusta):
        raise TypeError('only bodies of revolution stand in water')
    rings, media = surface.rings, surface.media
    outer = np.arange(len(rings)) <= rings[:, 3].argmax()
    low, high = np.minimum(rings[:, 1], rings[:, 3]), np.maximum(rings[:, 1], rings[:, 3])
    cut = outer & (low < level) & (level < high)
    part = ((level - rings[cut, 1]) / (rings[cut, 3] - rings[cut, 1]))[:, None]
    middle = rings[cut, 0:2] + part * (rings[cut, 2:4] - rings[cut, 0:2])
    normal = rings[cut, 4:6] + part * (rings[cut, 6:8] - rings[cut, 4:6])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    first = np.concatenate([rings[cut, 0:2], middle, rings[cut, 4:6], normal], axis=1)
    second = np.concatenate([middle, rings[cut, 2:4], normal, rings[cut, 6:8]], axis=1)
    rings = np.concatenate([rings[~cut], first, second])
    media = np.concatenate([media[~cut], media[cut], media[cut]])
    outer = np.concatenate([outer[~cut], np.ones(2 * cut.sum(), bool)])
    wet = outer & (rings[:, [1, 3]].mean(axis=1) < level)
    media = np.where(wet[:, None] & (media == 0), len(solid.media) + 1, media)
    return (replace(solid, surface=Frusta(rings, media), media=(*solid.media, WATER)),
            float(middle[:, 0].max(initial=0.0)))


def water_surface(rng: np.random.Generator, low: NDArray[np.floating], high: NDArray[np.floating],
                  level: float, slope: float, hole: float = 0.0,
                  jet: NDArray[np.floating] | None = None) -> Solid:
    """The surface of water between two corners (x, y) about the origin [m], with random waves.

    slope: of the waves, root of the mean square [1]. hole: radius of what stands in it at the
    origin [m]. jet: (2,) where one falls in: rings run from there. Only the surface: the
    basin bounds the water elsewhere.
    """
    turn = 2 * np.pi * np.arange(_AROUND) / _AROUND
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    edge = (np.where(way > 0, high, -np.asarray(low)) / np.maximum(np.abs(way), 1e-9)).min(axis=1)
    part = np.linspace(0, 1, _OUT)
    radius = hole + part[:, None] * (edge - hole)
    points = radius[..., None] * way
    calm = np.clip((radius - hole) / _CALM, 0, 1) if hole else 1.0
    z = level + calm * _waves(rng, points, slope, jet)
    vertices = np.concatenate([points, z[..., None]], axis=-1).reshape(-1, 3)
    k, m = np.meshgrid(np.arange(_OUT - 1), np.arange(_AROUND), indexing='ij')
    a, b = (k * _AROUND + m).ravel(), (k * _AROUND + (m + 1) % _AROUND).ravel()
    faces = np.concatenate([np.stack([a, a + _AROUND, b + _AROUND], axis=1),
                            np.stack([a, b + _AROUND, b], axis=1)])
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return Solid(Triangles(corners[across[:, 2] > 1e-12], 0, 1), (WATER,), np.eye(4))


def _waves(rng: np.random.Generator, points: NDArray[np.float64], slope: float,
           jet: NDArray[np.floating] | None) -> NDArray[np.float64]:
    """Heights (...) of waves that run in all directions, at points (..., 2)."""
    length = np.exp(rng.uniform(np.log(_LENGTHS[0]), np.log(_LENGTHS[1]), _WAVES))
    turn, phase = rng.uniform(0, 2 * np.pi, (2, _WAVES))
    number = 2 * np.pi / length
    along = points @ np.stack([np.cos(turn), np.sin(turn)]) * number
    height = (np.sin(along + phase) / number).sum(axis=-1) * slope * np.sqrt(2 / _WAVES)
    if jet is not None:
        away = np.linalg.norm(points - jet, axis=-1)
        ring = rng.uniform(*_LENGTHS) / 2
        height = height + slope * ring / np.pi * np.cos(2 * np.pi * away / ring) * np.exp(
            -away / 0.08)
    return np.asarray(height)


def water_jet(rng: np.random.Generator, radius: float, bottom: float, top: float) -> Solid:
    """A jet about the z axis, a little wavy, narrower below [m]."""
    z = np.linspace(bottom, top, _RINGS)
    thinner = 1 - 0.35 * (top - z) / (top - bottom)
    length, phase = rng.uniform(0.008, 0.04, (3, 1)), rng.uniform(0, 1, (3, 1))
    wave = 0.04 * np.sin(2 * np.pi * (z / length + phase)).sum(axis=0)
    side = np.stack([radius * thinner * (1 + wave), z], axis=1)
    profile = np.concatenate([[[0, bottom]], side, [[0, top]]])
    return Solid(Frusta.from_profile(profile, 0, 1), (WATER,), np.eye(4))
