"""Moves axis, profile and ends to the place of most evidence, by the contour's offsets."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from pmcl_ros.evidence.energies import evidence_across
from pmcl_ros.evidence.model_error import FACING
from pmcl_ros.profiles.revolution import AXIS, ENDS, Revolution, RevolutionContour
from pmcl_ros.profiles.search import PosedMap

_WINDOW = 3.0  # px of contour that is judged as one
_INWARDS = 0.35  # px: by so much glass shows its outline inside of it
_APART = 7.0  # px along a contour, beyond which its errors are independent
_STEP = 0.5  # px between shifts across the contour
_TURN = 0.16  # rad: turn of the wall from knot to knot that is as likely as not
_TILT, _ASIDE, _END = 0.03, 0.02, 0.03  # rad, m, m: how far the start may be off
_EDGES = np.array([0.003, 0.0015])  # m: radii of the edges of bottom and top, and their spread
_HEIGHT = 0.0005  # m: standard deviation of a given height
_OVERSURE = 1.5  # by so much errors are larger: what the curvature does not tell
_LEAST = 0.0005  # m: of radii


@dataclass(frozen=True)
class Normal:
    """The normal equations of a surface's parameters.

    information: (p, p), gradient: (p,). evidence, length: of the contour, sums over it [nat, px].
    """

    information: NDArray[np.float64]
    gradient: NDArray[np.float64]
    evidence: float
    length: float

    @property
    def scaled(self) -> float:
        """The evidence as a log likelihood: neighbouring points are not independent."""
        return _WINDOW / _APART * self.evidence


def refined(surface: Revolution, maps: Sequence[PosedMap], reach: float, steps: int,
            height: float | None = None, with_edge: bool = True) -> Revolution:
    """The surface after some steps.

    reach: standard deviation of the contour's offset [px]. height: of the object, where it is
    known [m]. with_edge: whether the radius of the bottom's edge may change, but
    where it becomes impossible.
    """
    free = np.ones(len(surface.radii) + ENDS + AXIS, bool)
    free[len(surface.radii) + 2] = with_edge
    seen = normal_equations(surface, maps, reach)
    prior = _prior(surface, height)
    damping = 0.0
    for _ in range(steps):
        information = seen.information + prior.information
        damped = information + damping * np.diag(np.diag(information))
        step = np.zeros(len(free))
        step[free] = np.linalg.solve(damped[np.ix_(free, free)],
                                     (seen.gradient + prior.gradient)[free])
        tried = surface.moved(step, _LEAST)
        tried_seen, tried_prior = normal_equations(tried, maps, reach), _prior(tried, height)
        if tried_seen.scaled + tried_prior.evidence > seen.scaled + prior.evidence:
            surface, seen, prior, damping = tried, tried_seen, tried_prior, damping / 10
        else:
            damping = max(10 * damping, 0.01)
    return surface


def with_usual_edge(surface: Revolution, maps: Sequence[PosedMap], reach: float, steps: int
                    ) -> Revolution:
    """The surface with a bottom edge of the usual radius, refined.

    From above, a round edge looks like a sharp one that is higher, so evidence tells the radius
    and the height of the bottom only together. The rest as in `refined`.
    """
    edge = min(_EDGES[0], surface.foot / 3)
    usual = surface.with_edges(np.array([edge, surface.edges[1]]), _LEAST)
    return refined(usual, maps, reach, steps, with_edge=False)


def normal_equations(surface: Revolution, maps: Sequence[PosedMap], reach: float) -> Normal:
    """The evidence across the contour, as a Gaussian offset at each point."""
    size = len(surface.radii) + ENDS + AXIS
    information, gradient = np.zeros((size, size)), np.zeros(size)
    evidence, length = 0.0, 0.0
    for each in maps:
        contour = surface.contour(each.evidence.pinhole, each.camera)
        here, mean, variance = _offsets(contour, each, reach)
        weight = contour.lengths / _APART
        known = weight * np.maximum(1 / variance - 1 / reach ** 2, 0)
        information += contour.motion.T @ (known[:, None] * contour.motion)
        gradient += contour.motion.T @ (weight * mean / variance)
        evidence += float(contour.lengths @ here)
        length += float(contour.lengths.sum())
    return Normal(information, gradient, evidence, length)


def _offsets(contour: RevolutionContour, view: PosedMap, reach: float
             ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Of each point: evidence there [nat / px], mean [px] and variance [px^2] of its offset."""
    shifts = np.arange(-2 * reach, 2 * reach + _STEP / 2, _STEP)
    profile = view.evidence.profile
    inwards = _INWARDS + float(profile.offsets[0])  # by its own offset the profile reads aside
    table = evidence_across(view.evidence, contour.pixels - inwards * contour.normals,
                            contour.normals, contour.depths, profile, shifts)
    logs = _WINDOW * table - shifts ** 2 / (2 * reach ** 2)
    weights = np.exp(logs - logs.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    mean = weights @ shifts
    variance = np.maximum(weights @ shifts ** 2 - mean ** 2, _STEP ** 2 / 12)
    return table[:, len(shifts) // 2], mean, variance


def _prior(surface: Revolution, height: float | None) -> Normal:
    """What is known before: smoothness, and about where it stands."""
    count = len(surface.radii)
    off, bends = surface.turns
    known = 2 / (_TURN ** 2 + off ** 2)  # Cauchy: a profile has few corners
    information = np.zeros((count + ENDS + AXIS,) * 2)
    information[:count, :count] = bends.T @ (known[:, None] * bends)
    gradient = np.zeros(len(information))
    gradient[:count] = -bends.T @ (known * off)
    weak = np.array([_END, _END, *_EDGES, _ASIDE, _ASIDE, _TILT, _TILT])
    information[count:, count:] += np.diag(1 / weak ** 2)
    edges = (np.array(surface.edges) - _EDGES) / _EDGES
    gradient[count + 2:count + ENDS] = -edges / _EDGES
    if height is not None:
        ends = np.zeros(len(gradient))
        ends[count:count + 2] = -1 / _HEIGHT, 1 / _HEIGHT
        off_height = (surface.high - surface.low - height) / _HEIGHT
        information += np.outer(ends, ends)
        gradient -= off_height * ends
        edges = np.append(edges, off_height)
    return Normal(information, gradient,
                  -float(np.log1p((off / _TURN) ** 2).sum() + (edges ** 2).sum() / 2), 0.0)


def deviations(surface: Revolution, maps: Sequence[PosedMap], reach: float,
               height: float | None = None) -> NDArray[np.float64]:
    """(m,) standard deviations of the points of `surface.wall` along their normals [m].

    By the curvature of the evidence and the prior, and the model error (`ModelError`), which is
    of each view.
    """
    information = _prior(surface, height).information
    errors = np.zeros_like(information)
    for each in maps:
        contour = surface.contour(each.evidence.pinhole, each.camera)
        _, _, variance = _offsets(contour, each, reach)
        known = contour.lengths / _APART * np.maximum(1 / variance - 1 / reach ** 2, 0)
        pulled = known[:, None] * contour.motion
        information = information + contour.motion.T @ pulled
        apart = cdist(contour.pixels, contour.pixels)
        same_side = contour.normals @ contour.normals.T > FACING
        off = each.evidence.model_error.covariance(apart, same_side)
        errors += pulled.T @ off @ pulled
    covariance = np.linalg.inv(information)
    covariance = covariance + covariance @ errors @ covariance
    motion = np.pad(surface.motion, ((0, 0), (0, AXIS)))
    return _OVERSURE * np.sqrt(np.einsum('mi,ij,mj->m', motion, covariance, motion))
