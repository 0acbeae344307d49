"""A sink with water, and a tank behind a film."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.runtime.errors import SimulationError
from pmcl_ros.simulation.described.place import Frame, Furnished, Place
from pmcl_ros.simulation.described.substances import WATER
from pmcl_ros.simulation.described.water import (
    can_stand_in_water,
    standing_in_water,
    submerged,
    water_jet,
    water_surface,
)
from pmcl_ros.simulation.scenes.broad_scene import Palette
from pmcl_ros.simulation.scenes.materials import Opaque
from pmcl_ros.simulation.scenes.random_scene import random_film
from pmcl_ros.simulation.scenes.scene import Sheet, Solid
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.textures import SIZE

_RUNNING = 0.5  # share of sinks with running water
_STEEL = 0.5  # share of sinks; others are ceramic
_SHALLOW = 0.012  # m: least depth of the water, so that no wave reaches the floor
LEDGE = 0.006  # m: by which a ledge is higher than the water, so that no wave washes over it
GAP = 1e-4  # m: between an object and what it lies on
BEYOND = 0.003  # m: by which water reaches into walls, so that no air lies between
_COUNTER = 1.0  # m
_TANK = 0.8  # of the camera's distance: a tank's front may come so near to it


def sink(rng: np.random.Generator, place: Place) -> Furnished:
    """A basin of steel or ceramic with standing or running water, below a counter.

    An upright body of revolution stands in the water, dry inside. Anything else lies on a ledge
    just above it, as a Solid's media nest within that solid only. The jet ends on the water's
    surface, which goes on below it. Steel reflects less than it should: coats are dielectric.
    """
    frame = place.facing(rng, 0.6)  # the wall is behind
    depth = rng.uniform(0.13, 0.22)
    half = np.maximum(rng.uniform([0.17, 0.15], [0.28, 0.21]), place.reach + 0.03)
    middle = rng.uniform(-1, 1, 2) * (half - place.reach - 0.025)
    low, high = middle - half, middle + half
    metal = random_finish(rng)
    water = max(_SHALLOW, rng.uniform(0.15, 0.75) * min(place.top, 0.75 * depth))
    stands = not place.empty and place.stands and place.top > 2 * _SHALLOW and can_stand_in_water(
        place.item)
    level = water if stands else -LEDGE  # of the water, where the object's support is 0
    target, hole, solids = place.target, 0.0, []
    if stands:
        wet, hole = standing_in_water(place.item.solids[0], level - place.world[2, 3])
        target = replace(place.item, solids=(wet,)).placed(place.camera @ place.world)
    elif not place.empty:
        side = place.reach + 0.01
        solids.append(frame.box(np.array([-side, -side, level - water]),
                                np.array([side, side, -GAP]), metal))
    is_running = rng.random() < _RUNNING
    jet = _free_spot(rng, low, high, place.reach) if is_running else None
    slope = float(rng.uniform(0.04, 0.15) if is_running else rng.uniform(0.003, 0.03))
    solids.append(frame.solid(water_surface(rng, low - BEYOND, high + BEYOND, level, slope, hole,
                                            jet)))
    floor, rim = level - water, level - water + depth
    if jet is not None:
        outlet = rim + rng.uniform(0.05, 0.15)
        solids += running_water(rng, frame, jet, rng.uniform(0.003, 0.007), (level, outlet),
                                high[1] + 0.1, metal)
    sheets = basin(frame, low, high, (floor, rim), metal, place.palette)
    return Furnished(target, tuple(solids), tuple(sheets))


def random_finish(rng: np.random.Generator) -> Opaque:
    """Steel or ceramic."""
    if rng.random() < _STEEL:
        tone, coat, rough = rng.uniform(0.35, 0.6), 2.5, rng.uniform(0.05, 0.3)
    else:
        tone, coat, rough = rng.uniform(0.6, 0.88), 1.5, rng.uniform(0, 0.1)
    colour = np.broadcast_to(np.full(3, tone, np.float32), (SIZE, SIZE, 3))
    return Opaque(colour, 0.3, coat, float(rough))


def basin(frame: Frame, low: NDArray[np.floating], high: NDArray[np.floating],
          heights: tuple[float, float], of: Opaque, palette: Palette) -> list[Sheet]:
    """A floor and four walls between two corners (x, y), a counter around and a wall behind it.

    heights: of the floor and of the counter [m].
    """
    (x0, y0), (x1, y1), (floor, rim) = low.tolist(), high.tolist(), heights
    finish, counter = (of.texture, of.side, of.coat, of.roughness), palette.texture()
    far = _COUNTER
    around = (((x0 - far, y1), (x1 + far, y1 + far)), ((x0 - far, y0 - far), (x1 + far, y0)),
              ((x0 - far, y0), (x0, y1)), ((x1, y0), (x1 + far, y1)))
    return [frame.level((x0, y0), (x1, y1), floor, *finish),
            *(frame.across_x(x, (y0, y1), heights, *finish) for x in (x0, x1)),
            *(frame.across_y((x0, x1), y, heights, *finish) for y in (y0, y1)),
            *(frame.level(*corners, rim, counter, 0.5, 1.5, 0.1) for corners in around),
            frame.across_y((x0 - far, x1 + far), y1 + 0.15, (rim, rim + 0.8), palette.texture(),
                           0.6)]


def _free_spot(rng: np.random.Generator, low: NDArray[np.floating], high: NDArray[np.floating],
               reach: float) -> NDArray[np.float64] | None:
    """(2,) in the basin beside what stands at its origin; None where that fills it."""
    for _ in range(30):
        spot = rng.uniform(low + 0.04, high - 0.04)
        if np.linalg.norm(spot) > reach + 0.025:
            return np.asarray(spot)
    return None


def running_water(rng: np.random.Generator, frame: Frame, spot: NDArray[np.floating],
                  radius: float, heights: tuple[float, float], back: float, metal: Opaque
                  ) -> list[Solid]:
    """A jet of a radius [m] at a spot (2,) of a frame, the spout above it, its arm to a wall.

    heights: of the water and of the spout's outlet, back: y of the wall, in the frame [m].
    """
    level, outlet = heights
    at = Frame(frame.pose @ pose_of(Rotation.identity(), np.append(spot, 0)))
    profile = np.array([[0, outlet + 0.0005], [0.011, outlet + 0.0005], [0.012, outlet + 0.04],
                        [0, outlet + 0.04]])
    spout = at.solid(Solid(Frusta.from_profile(profile, 0, 1), (metal,), np.eye(4)))
    arm = at.box(np.array([-0.009, 0.0, outlet + 0.02]),
                 np.array([0.009, back - float(spot[1]), outlet + 0.038]), metal)
    return [at.solid(water_jet(rng, radius, level + 0.001, outlet)), spout, arm]


def tank_distance(reach: float) -> float:
    """Least distance of a camera [m] from an object with a footprint of a radius [m] in a tank."""
    return (reach + BEYOND) / _TANK


def tank(rng: np.random.Generator, place: Place) -> Furnished:
    """A tank full of water with a flat front, behind a textured film; the object is in the water.

    Its panes are left out: they would shift what is behind them by a third of their thickness.
    """
    if tank_distance(place.reach) > place.near:
        raise SimulationError(f'{place.item.name} is too large for a tank {place.near:g} m from '
                              f'the camera: {tank_distance(place.reach):.2f} m are needed')
    frame = place.facing(rng, 0.3)
    front = -max(min(place.reach + rng.uniform(0.02, 0.12), 0.6 * place.near),
                 place.reach + BEYOND)
    back = place.reach + rng.uniform(0.03, 0.25)
    half = place.reach + rng.uniform(0.06, 0.25)
    height = place.top + rng.uniform(0.02, 0.12)
    aside = rng.uniform(-0.5, 0.5) * (half - place.reach)
    left, right = aside - half, aside + half
    target = tuple(submerged(each) for each in place.target)
    water = frame.box(np.array([left, front, -BEYOND]), np.array([right, back, height]), WATER)
    ground, behind = place.palette.texture(), place.palette.texture()
    sheets = [frame.level((-2, -2), (2, 2), 0.0, ground, float(rng.uniform(0.1, 0.6)))]
    if rng.random() < 0.6:
        sheets.append(frame.across_y((left, right), back - 0.001, (0, height), behind,
                                     float(rng.uniform(0.15, 0.6))))
    else:
        sheets.append(frame.across_y((-2, 2), back + rng.uniform(0.05, 0.8), (0, 1.5), behind,
                                     float(rng.uniform(0.2, 1.0))))
    film = random_film(rng, 1.0)
    screen = frame.across_y((left - 0.02, right + 0.02), front - 0.002, (0, height + 0.02),
                            film.texture, film.side)
    return Furnished(target, (water,), (*sheets, replace(screen, opacity=film.opacity)))
