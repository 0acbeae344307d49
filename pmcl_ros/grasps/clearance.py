"""Clearance of an object between the open fingers, and the probability of a free approach."""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri, owens_t

from pmcl_ros.grasps.grasp import Grasp
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.pmcl.object_model import ObjectModel

# m: ends of the strips of shifts along the fingers' width; the middle strip is about 0
_EDGES = np.array([-24, -17, -12, -8, -5, -3, -1, 1, 3, 5, 8, 12, 17, 24]) * 1e-3
_MIDDLE = len(_EDGES) // 2 - 1
_QUANTILES = (0.25, 0.75)  # of a strip, at which its probability is evaluated
_DEPTHS = (0.15, 0.35, 0.6, 0.8, 1.0)  # shares of the room before the palm
_SPACING = 0.002  # m: between points of the surface, on objects up to 0.3 m
_STEP, _SPAN = 0.001, 0.004  # m: step and length for the lean of a wall


@dataclass(frozen=True)
class Clearance:
    """Shifts of the object at which an open gripper reaches the grasp without contact.

    A shift is the error of the object's position in the grasp frame. Shifts along z are divided
    into strips. Each strip has several rectangles of shifts along y and x, as room before the
    palm costs room beside the fingers where the object widens. In each rectangle fingers and palm
    are clear of the object during the straight approach along x, and the fingers close on walls
    that friction holds.

    strips: (k, 2) ends along z [m]. low, high: (k, m, 2) ends of the rectangles along y (closing)
        and x (approach) [m]; one is empty where low is not below high.
    """

    strips: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def from_points(cls, grasp: Grasp, points: NDArray[np.float64], gripper: GripperSettings
                    ) -> 'Clearance':
        """Of points (n, 3) of the surface, in the object's frame [m]."""
        seen = in_grasp_frame(grasp, points)
        strips = np.stack([_EDGES[:-1], _EDGES[1:]], axis=1)
        rooms = np.array([_rooms(seen, gripper, grasp.opening, *strip) for strip in strips])
        return cls(strips, rooms[:, 0], rooms[:, 1])

    @property
    def room(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Low and high (2,) of the largest rectangle in the strip about z = 0 [m]."""
        low, high = self.low[_MIDDLE], self.high[_MIDDLE]
        best = int(np.minimum(-low, high).min(axis=1).argmax())
        return low[best], high[best]

    @property
    def least(self) -> float:
        """The least room on any side of the object at a shift of 0 [m]."""
        low, high = self.room
        return float(min(-low.max(), high.min()))

    def probability(self, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
        """(...) probability that the open fingers clear the object and then hold it.

        covariance: (..., 3, 3) [m^2] of the object's shift in the grasp frame, Gaussian about 0.

        A sum over the strips of z. Given z, the shifts along y and x are bivariate normal; their
        probability in a rectangle is closed, by Owen's T function. The best rectangle of a strip
        counts. Shifts beyond the strips do not count: the result is a lower bound.
        """
        sigma = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 1e-18))
        below = ndtr(self.strips / sigma[..., 2, None, None])  # (..., k, 2)
        mass = below[..., 1] - below[..., 0]
        total = np.zeros(covariance.shape[:-2])
        for part in _QUANTILES:
            z = sigma[..., 2, None] * np.clip(ndtri(below[..., 0] + part * mass), -40, 40)
            given = self._given(covariance, sigma[..., 2], z).max(axis=-1)
            total += (mass * given).sum(axis=-1) / len(_QUANTILES)
        return np.clip(total, 0, 1)

    def _given(self, covariance: NDArray[np.float64], sigma: NDArray[np.float64],
               z: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., k, m) probability of each rectangle, given a shift z (..., k) in each strip."""
        cross = covariance[..., [1, 0], 2]
        slope = cross / sigma[..., None] ** 2
        variance = np.diagonal(covariance, axis1=-2, axis2=-1)[..., [1, 0]] - slope * cross
        scale = np.sqrt(np.maximum(variance, 1e-18))
        both = covariance[..., 1, 0] - slope[..., 0] * cross[..., 1]
        correlation = (both / scale.prod(axis=-1))[..., None, None]
        mean, scale = (slope[..., None, :] * z[..., None])[..., None, :], scale[..., None, None, :]
        return rectangle_probability((self.low - mean) / scale, (self.high - mean) / scale,
                                     correlation)


def in_grasp_frame(grasp: Grasp, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) points of the object's frame, expressed in the grasp frame."""
    return (points - grasp.pose[:3, 3]) @ grasp.pose[:3, :3]


def surface_points(model: ObjectModel) -> NDArray[np.float64]:
    """(n, 3) points of the surface [m], about 2 mm apart: vertices, edges and faces."""
    spacing = max(_SPACING, model.diameter / 150)
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
    ends = model.vertices[mesh.edges_unique]
    pieces = np.ceil(mesh.edges_unique_length / spacing).astype(int)
    edge = np.repeat(np.arange(len(ends)), pieces)
    part = (np.arange(len(edge)) - np.repeat(pieces.cumsum() - pieces, pieces)) / pieces[edge]
    along = ends[edge, 0] + part[:, None] * (ends[edge, 1] - ends[edge, 0])
    between = trimesh.sample.sample_surface(mesh, int(4 * mesh.area / spacing ** 2) + 1, seed=0)[0]
    points = np.concatenate([along, between])
    # Slender triangles give too many points: one is kept in each cell, and all vertices.
    _, kept = np.unique(np.floor(points / (spacing / 2)), axis=0, return_index=True)
    return np.concatenate([model.vertices, points[kept]])


def held(points: NDArray[np.float64], gripper: GripperSettings, opening: float
         ) -> NDArray[np.float64]:
    """(m, 3) points between the fingers, of points (n, 3) in the grasp frame."""
    return _between(points[abs(points[:, 2]) <= gripper.finger_width / 2], gripper, opening)


def _between(level: NDArray[np.float64], gripper: GripperSettings, opening: float
             ) -> NDArray[np.float64]:
    middle = (opening + gripper.finger_thickness) / 2
    return level[(level[:, 0] <= gripper.tip) & (abs(level[:, 1]) < middle)]


def _rooms(points: NDArray[np.float64], gripper: GripperSettings, opening: float, first: float,
           last: float) -> NDArray[np.float64]:
    """(2, m, 2) low and high of the rectangles of one strip, for points in the grasp frame.

    first, last: ends of the strip along z [m].
    """
    def level(height: float) -> NDArray[np.float64]:
        z = points[:, 2]
        return points[(z >= -height / 2 - last) & (z <= height / 2 - first)]

    fingers = level(gripper.finger_width)
    between = _between(fingers, gripper, opening)
    if not len(between):
        return np.zeros((2, len(_DEPTHS), 2))
    far = min(_hold(between[:, 0], sign * between[:, 1], gripper) for sign in (1, -1))
    low, high = _beside(fingers[fingers[:, 0] <= gripper.tip, 1], gripper, opening)
    # A shift along x may come with one along y, for which the palm is effectively wider.
    palm, half = level(gripper.palm_height), gripper.palm_width / 2 + max(high, -low, 0)
    room = min(palm[abs(palm[:, 1]) <= half, 0].min(initial=np.inf) - gripper.palm,
               gripper.finger_length)
    lows, highs = [], []
    for depth in room * np.array(_DEPTHS):
        low, high = _beside(fingers[fingers[:, 0] <= gripper.tip + max(depth, 0), 1], gripper,
                            opening)
        lows.append([low, -depth])
        highs.append([high, far])
    return np.array([lows, highs])


def _beside(y: NDArray[np.float64], gripper: GripperSettings, opening: float
            ) -> tuple[float, float]:
    """Shifts along y [m] at which points at y (n,) touch the inside or outside of a finger."""
    inner, outer = opening / 2, opening / 2 + gripper.finger_thickness
    between = abs(y) < (inner + outer) / 2
    beyond = y[~between]
    high = min(inner - y[between].max(), (-outer - beyond[beyond < 0]).min(initial=np.inf))
    low = max(-inner - y[between].min(), (outer - beyond[beyond > 0]).max(initial=-np.inf))
    return float(low), float(high)


def _hold(x: NDArray[np.float64], y: NDArray[np.float64], gripper: GripperSettings) -> float:
    """Largest shift along x until a finger at +y would slip off the object [m].

    The finger touches the largest y in its reach. It slips where y still grows at the fingertip by
    more than friction holds, or where nothing is in reach.
    """
    order = np.argsort(x)
    widest = np.r_[-np.inf, np.maximum.accumulate(y[order])]
    tips = np.arange(gripper.tip, gripper.palm, -_STEP)
    at_tip, before = (widest[np.searchsorted(x[order], each, 'right')]
                      for each in (tips, tips - _SPAN))
    slips = at_tip > before + gripper.friction * _SPAN
    return float(_STEP * (slips.argmax() if slips.any() else len(tips)))


def rectangle_probability(low: NDArray[np.float64], high: NDArray[np.float64],
                          correlation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...) probability that two standard normal variables lie between low and high (..., 2).

    correlation: (...) of both. 0 where a low is not below its high.
    """
    parts = [(_below(first[..., 0], second[..., 1], correlation), sign)
             for first, second, sign in ((high, high, 1), (low, high, -1), (high, low, -1),
                                         (low, low, 1))]
    total = sum(sign * part for part, sign in parts)
    return np.where((low < high).all(axis=-1), np.clip(total, 0, 1), 0.0)


def _below(h: NDArray[np.float64], k: NDArray[np.float64], correlation: NDArray[np.float64]
           ) -> NDArray[np.float64]:
    """P(X < h, Y < k) for standard normal X, Y (Owen, Ann. Math. Stat. 27, 1956, eq. 2.1)."""
    h, k = (np.where(abs(each) < 1e-12, 1e-12, np.clip(each, -40, 40)) for each in (h, k))
    rho = np.clip(correlation, -1 + 1e-12, 1 - 1e-12)
    root = np.sqrt(1 - rho ** 2)
    apart = np.where(h * k < 0, 0.5, 0.0)
    return ((ndtr(h) + ndtr(k)) / 2 - owens_t(h, (k / h - rho) / root)
            - owens_t(k, (h / k - rho) / root) - apart)
