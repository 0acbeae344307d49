"""Resolve the penetration of objects by the smallest change of their poses."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.multi_object.solid import Contact, Solid, contact

MAX_PENETRATION = 0.002  # m: of two objects in an estimate
_RESIDUAL = 0.001  # m: residual penetration; surfaces are sampled at about 1 mm
_ITERATIONS = 40


@dataclass(frozen=True)
class PlacedSolid:
    """A solid at a pose (4, 4), and the covariance (6, 6) of that pose [m, rad]."""

    solid: Solid
    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]


@dataclass(frozen=True)
class Resolution:
    """Changes of poses that resolve penetration.

    deviations: (n, 6) tangent vectors (`se3.retract`) [m, rad]. cost: half their squared
    Mahalanobis distance by the poses' covariances [nat]. depth: of the deepest pair that remains
    [m]. pair: its indices; empty for fewer than two solids.
    """

    deviations: NDArray[np.float64]
    cost: float
    depth: float
    pair: tuple[int, ...]


def resolve_penetration(solids: Sequence[PlacedSolid], most: float = np.inf) -> Resolution:
    """Move solids until no two penetrate each other deeper than 1 mm.

    Each iteration moves the deepest pair so that its deepest point leaves the other solid, by the
    least squared Mahalanobis distance: a projection on the linearized constraint.
    most: stop where the cost is larger [nat].
    """
    poses = np.array([each.pose for each in solids]).reshape(-1, 4, 4)
    deviations = np.zeros((len(solids), 6))
    contacts: dict[tuple[int, ...], Contact] = {
        pair: _contact(solids, poses, *pair) for pair in combinations(range(len(solids)), 2)}
    for _ in range(_ITERATIONS):
        if not contacts:
            break
        first, second = max(contacts, key=lambda pair: contacts[pair].depth)
        deepest = contacts[first, second]
        if deepest.depth <= _RESIDUAL:
            break
        gradients = {k: sign * np.concatenate([
            deepest.normal, np.cross(deepest.place - poses[k, :3, 3], deepest.normal)])
            for k, sign in ((first, 1.0), (second, -1.0))}
        directions = {k: solids[k].covariance @ gradient for k, gradient in gradients.items()}
        gain = sum(float(gradients[k] @ directions[k]) for k in gradients)
        # A little farther than the linear constraint asks for: surfaces are curved.
        wanted = deepest.depth - 0.5 * _RESIDUAL
        for k, direction in directions.items():
            step = direction * wanted / gain
            deviations[k] += step
            poses[k] = retract(solids[k].pose, deviations[k][None])[0]
        if _cost(solids, deviations) > most:
            break
        for pair in contacts:
            if first in pair or second in pair:
                contacts[pair] = _contact(solids, poses, *pair)
    last = max(contacts, key=lambda pair: contacts[pair].depth, default=())
    depth = contacts[last].depth if last else -np.inf
    return Resolution(deviations, _cost(solids, deviations), depth, last)


def deepest_penetration(solids: Sequence[tuple[Solid, NDArray[np.float64]]]) -> float:
    """Depth [m] of the deepest pair of solids at poses (4, 4); 0 or less without penetration."""
    return max((contact(*one, *other).depth for one, other in combinations(solids, 2)),
               default=0.0)


def _contact(solids: Sequence[PlacedSolid], poses: NDArray[np.float64], first: int, second: int
             ) -> Contact:
    return contact(solids[first].solid, poses[first], solids[second].solid, poses[second])


def _cost(solids: Sequence[PlacedSolid], deviations: NDArray[np.float64]) -> float:
    """Half the sum of squared Mahalanobis distances [nat]."""
    total = 0.0
    for each, deviation in zip(solids, deviations, strict=True):
        # Metres and radians differ in size; the covariance is singular about an axis of symmetry.
        total += float(deviation @ np.linalg.pinv(each.covariance, 1e-12) @ deviation)
    return 0.5 * total
