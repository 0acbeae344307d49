"""Objects that interpenetrate, moved apart by as little as what is known of them allows."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.multi_object.solid import Contact, Solid, contact

DEEPEST = 0.002  # m: deeper no two objects are in each other
_AIMED = 0.001  # m: so deep they are left, as points of a surface tell it not quite
_ROUNDS = 40


@dataclass(frozen=True)
class Placed:
    """A solid at a pose (4, 4), and the covariance (6, 6) of that pose [m, rad]."""

    solid: Solid
    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]


@dataclass(frozen=True)
class Apart:
    """deviations: (n, 6) by which they are moved (`se3.retract`).

    cost: of that by the poses' covariances [nat]. depth: of the deepest pair that is left [m].
    pair: its numbers; none of fewer than two.
    """

    deviations: NDArray[np.float64]
    cost: float
    depth: float
    pair: tuple[int, ...]


def apart(things: Sequence[Placed], dearest: float = np.inf) -> Apart:
    """Move things until no two are deeper in each other than `_AIMED`.

    Each round moves the deepest pair so that their deepest point comes out, by the least squared
    deviation in the metric of both covariances: a projection on the linearised constraint.
    dearest: what costs more is given up.
    """
    poses = np.array([each.pose for each in things]).reshape(-1, 4, 4)
    off = np.zeros((len(things), 6))
    known: dict[tuple[int, ...], Contact] = {
        pair: _contact(things, poses, *pair) for pair in combinations(range(len(things)), 2)}
    for _ in range(_ROUNDS):
        if not known:
            break
        first, second = max(known, key=lambda pair: known[pair].depth)
        deepest = known[first, second]
        if deepest.depth <= _AIMED:
            break
        rates = {k: sign * np.concatenate([
            deepest.normal, np.cross(deepest.place - poses[k, :3, 3], deepest.normal)])
            for k, sign in ((first, 1.0), (second, -1.0))}
        ways = {k: things[k].covariance @ rate for k, rate in rates.items()}
        gain = sum(float(rates[k] @ ways[k]) for k in rates)
        # A little farther than the linear constraint says: surfaces are bent.
        wanted = deepest.depth - 0.5 * _AIMED
        for k, way in ways.items():
            step = way * wanted / gain
            off[k] += step
            poses[k] = retract(things[k].pose, off[k][None])[0]
        if _cost(things, off) > dearest:
            break
        for pair in known:
            if first in pair or second in pair:
                known[pair] = _contact(things, poses, *pair)
    last = max(known, key=lambda pair: known[pair].depth, default=())
    return Apart(off, _cost(things, off), known[last].depth if last else -np.inf, last)


def deepest_pair(things: Sequence[tuple[Solid, NDArray[np.float64]]]) -> float:
    """How deep the deepest two of solids at poses (4, 4) are in each other [m]; 0: none is."""
    return max((contact(*one, *other).depth for one, other in combinations(things, 2)),
               default=0.0)


def _contact(things: Sequence[Placed], poses: NDArray[np.float64], first: int, second: int
             ) -> Contact:
    return contact(things[first].solid, poses[first], things[second].solid, poses[second])


def _cost(things: Sequence[Placed], off: NDArray[np.float64]) -> float:
    """Half the squared deviations, in standard deviations."""
    total = 0.0
    for each, deviation in zip(things, off, strict=True):
        # Metres and radians differ in size; about an axis of symmetry nothing is known or moved.
        total += float(deviation @ np.linalg.pinv(each.covariance, 1e-12) @ deviation)
    return 0.5 * total
