"""Where a simulated robot works: in its base frame, x ahead, y to the left, z up [m]."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.described.wet_places import GAP, LEDGE
from pmcl_ros.simulation.scenes.poses import Pose

WorkplaceKind = Literal['sink', 'tank']
# What is taken there, of config/objects, and its mass [kg].
OBJECTS: dict[WorkplaceKind, tuple[str, float]] = {'sink': ('tumbler', 0.2),
                                                   'tank': ('bottle', 0.83)}
Corner = tuple[float, float, float]
Corner2 = tuple[float, float]

_THICK = 0.02  # m: of walls, tray and shelf
_COUNTER = 0.75  # height of a counter, and of the table below a tank
# Of the basin (x, y). A tank is so far away that the camera can look through its front.
MIDDLE: dict[WorkplaceKind, Corner2] = {'sink': (0.65, 0.0), 'tank': (0.8, 0.0)}
_SIDE = 0.2  # of the square in which the object is


@dataclass(frozen=True)
class Box:
    """Something solid and fixed, between two corners."""

    name: str
    low: Corner
    high: Corner


@dataclass(frozen=True)
class Workplace:
    """A basin with water, and a tray beside it.

    low, high: corners (x, y) of the basin, inside. floor, rim: heights of its floor and of its
    walls. level: height of the water. ledge: on which a lying object is kept above the water.
    jet: (x, y) where water runs in from a tap. tray: the middle of its upper side. In a tank the
    object floats.
    """

    kind: WorkplaceKind
    low: Corner2
    high: Corner2
    floor: float
    rim: float
    level: float
    tray: Corner
    ledge: Box | None = None
    jet: Corner2 | None = None

    @property
    def boxes(self) -> tuple[Box, ...]:
        """What the arm and the object can touch; the tray's is called tray."""
        (x0, y0), (x1, y1), t = self.low, self.high, _THICK
        low, high = self.floor - t, self.rim
        tx, ty, tz = self.tray
        walls = (Box('floor', (x0 - t, y0 - t, low), (x1 + t, y1 + t, self.floor)),
                 Box('front', (x0 - t, y0 - t, low), (x0, y1 + t, high)),
                 Box('back', (x1, y0 - t, low), (x1 + t, y1 + t, high)),
                 Box('right', (x0, y0 - t, low), (x1, y0, high)),
                 Box('left', (x0, y1, low), (x1, y1 + t, high)),
                 Box('tray', (tx - 0.13, ty - 0.13, tz - t), (tx + 0.13, ty + 0.13, tz)))
        return (*walls, *self._tap, *([] if self.ledge is None else [self.ledge]))

    @property
    def faces(self) -> tuple[tuple[Corner, Corner], ...]:
        """Through which a camera can see into the water: a point of each, its normal into the air.

        The surface of a sink; of a tank its front and its sides too. Panes are so thin that they
        bend nothing.
        """
        surface = (0.0, 0.0, self.level), (0.0, 0.0, 1.0)
        if self.kind == 'sink':
            return (surface,)
        (x0, y0), y1, z = self.low, self.high[1], self.floor
        return (surface, ((x0, 0.0, z), (-1.0, 0.0, 0.0)), ((0.0, y0, z), (0.0, -1.0, 0.0)),
                ((0.0, y1, z), (0.0, 1.0, 0.0)))

    @property
    def _tap(self) -> tuple[Box, ...]:
        """A spout above the jet and its arm to the back wall."""
        if self.jet is None:
            return ()
        (x, y), z = self.jet, self.rim + 0.1
        return (Box('spout', (x - 0.012, y - 0.012, z), (x + 0.012, y + 0.012, z + 0.04)),
                Box('tap', (x, y - 0.009, z + 0.02), (self.high[0] + 0.1, y + 0.009, z + 0.038)))


@dataclass(frozen=True)
class Task:
    """An object at its place at the beginning. pose: (4, 4), object to base."""

    place: Workplace
    pose: NDArray[np.float64]
    stands: bool


def draw_task(rng: np.random.Generator, kind: WorkplaceKind, model: ObjectModel) -> Task:
    """The object anywhere in 20x20 cm, at any heading; in a sink half of them lie.

    model: upright along its z. In a tank the pose is near that in which it floats.
    """
    spot = np.array(MIDDLE[kind]) + rng.uniform(-_SIDE / 2, _SIDE / 2, 2)
    heading = Rotation.from_euler('z', rng.uniform(0, 2 * np.pi))
    if kind == 'tank':
        place = _tank(rng)
        return Task(place, _at(model, heading, spot, place.level, 0.6), True)
    stands = bool(rng.random() < 0.5)
    place = _sink(rng, spot, stands)
    if stands:
        return Task(place, _at(model, heading, spot, place.floor + GAP, 0.0), True)
    assert place.ledge is not None
    lying = heading * Rotation.from_euler('y', np.pi / 2)
    return Task(place, _at(model, lying, spot, place.ledge.high[2] + GAP, 0.0), False)


def _at(model: ObjectModel, turn: Rotation, spot: NDArray[np.float64], height: float,
        sunk: float) -> Pose:
    """The middle of the turned model above a spot (2,), a share of it below a height."""
    vertices = model.vertices @ turn.as_matrix().T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = (low + high) / 2
    return pose_of(turn, np.array([*(spot - middle[:2]),
                                   height - low[2] - sunk * (high[2] - low[2])]))


def _sink(rng: np.random.Generator, spot: NDArray[np.float64], stands: bool) -> Workplace:
    depth, water = rng.uniform(0.14, 0.17), rng.uniform(0.014, 0.03)
    floor = _COUNTER - depth
    low, high = _basin('sink', 0.22, 0.23)
    jet = None
    if rng.random() < 0.7:
        corner = np.array([high[0] - 0.05, rng.choice([-1, 1]) * 0.17])
        jet = float(corner[0]), float(corner[1])
    ledge = None
    if not stands:
        top = floor + water + LEDGE
        (x, y), half = spot.tolist(), 0.075
        ledge = Box('ledge', (x - half, y - half, floor), (x + half, y + half, top))
    return Workplace('sink', low, high, floor, _COUNTER, floor + water,
                     (0.52, float(rng.choice([-1, 1])) * 0.43, _COUNTER + _THICK), ledge, jet)


def _tank(rng: np.random.Generator) -> Workplace:
    deep = rng.uniform(0.16, 0.19)
    return Workplace('tank', *_basin('tank', 0.2, 0.25), _COUNTER, _COUNTER + deep + 0.04,
                     _COUNTER + deep, (0.5, -0.45, _COUNTER + _THICK))


def _basin(kind: WorkplaceKind, half_length: float, half_width: float) -> tuple[Corner2, Corner2]:
    """Its corners `low` and `high` [m]."""
    x, y = MIDDLE[kind]
    return ((x - half_length, y - half_width), (x + half_length, y + half_width))
