"""Errors of an object's surface at a pose against the truth.

MSSD, MSPD: Hodan et al., "BOP Challenge 2020 on 6D Object Localization", 2020, section 2.2. ADD-S:
Hinterstoisser et al., ACCV 2012.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.distance import cdist

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import rotations_about
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.object_model import ObjectModel

# Rotations tried about a continuous axis, as in BOP: each moves the surface by 2 % of its radius.
STEPS = 315
_MOST = 2 ** 18  # points or pairs of them at a time: some tens of MiB

_Distance = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True)
class Surface:
    """The points of an object that are measured, and its symmetry.

    points: (n, 3) the mesh's vertices [m]. corners: (m, 3) those of its convex hull.
    """

    points: NDArray[np.float64]
    corners: NDArray[np.float64]
    symmetry: Symmetry

    @classmethod
    def from_model(cls, model: ObjectModel) -> 'Surface':
        """The surface of an object."""
        corners = model.vertices[ConvexHull(model.vertices, qhull_options='QJ').vertices]
        return cls(model.vertices, corners, model.symmetry)

    @property
    def diameter(self) -> float:
        """The largest distance between two of its points [m]."""
        rows = max(1, _MOST // len(self.corners))
        return max(float(cdist(self.corners[first:first + rows], self.corners).max())
                   for first in range(0, len(self.corners), rows))

    def symmetries(self, turns: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k * n, 4, 4) rotations (n,) [rad] about the axis, then the discrete symmetries (k)."""
        if self.symmetry.axis is None:
            return self.symmetry.discrete
        turned = rotations_about(self.symmetry.axis, turns)
        return np.asarray((self.symmetry.discrete[:, None] @ turned).reshape(-1, 4, 4))

    def mssd(self, pose: NDArray[np.floating], truth: NDArray[np.floating]) -> float:
        """Maximum symmetry-aware surface distance [m]: least over the symmetries.

        pose, truth: (4, 4), object to camera [m]. The farthest point is a corner of the hull, as
        distance is convex.
        """
        found = transformed(pose[None], self.corners)

        def distance(motion: NDArray[np.float64]) -> NDArray[np.float64]:
            apart = transformed(truth @ motion, self.corners) - found
            return np.asarray(np.linalg.norm(apart, axis=-1).max(axis=-1))

        return self._least(_in_parts(distance, len(self.corners)))

    def mspd(self, pose: NDArray[np.floating], truth: NDArray[np.floating], pinhole: Pinhole
             ) -> float:
        """Maximum symmetry-aware projection distance [px]; infinite behind the camera.

        pose, truth: (4, 4), object to camera [m].
        """
        found = pinhole.project(transformed(pose[None], self.points))

        def distance(motion: NDArray[np.float64]) -> NDArray[np.float64]:
            apart = pinhole.project(transformed(truth @ motion, self.points)) - found
            return np.nan_to_num(np.linalg.norm(apart, axis=-1).max(axis=-1), nan=np.inf)

        return self._least(_in_parts(distance, len(self.points)))

    def add_s(self, pose: NDArray[np.floating], truth: NDArray[np.floating]) -> float:
        """Mean distance from the true points to the nearest point of the pose [m]; BOP's ADI.

        pose, truth: (4, 4), object to camera [m].
        """
        nearest, _ = cKDTree(transformed(pose[None], self.points)[0]).query(
            transformed(truth[None], self.points)[0])
        return float(np.mean(nearest))

    def _least(self, distance: _Distance) -> float:
        """The least distance over all symmetries: over BOP's steps, then refined between them."""
        discrete = self.symmetry.discrete
        if self.symmetry.axis is None:
            return float(distance(discrete).min())
        turns = 2 * np.pi * np.arange(STEPS) / STEPS
        values = distance(self.symmetries(turns)).reshape(len(discrete), STEPS)
        which, best = np.unravel_index(values.argmin(), values.shape)
        step, count = 2 * np.pi / STEPS, len(discrete)

        def between(turn: float) -> float:
            return float(distance(self.symmetries(np.array([turn]))).reshape(count)[which])

        refined = minimize_scalar(between, bounds=(turns[best] - step, turns[best] + step),
                                  method='bounded', options={'xatol': 1e-6})
        return float(min(values.min(), refined.fun))


def _in_parts(distance: _Distance, count: int) -> _Distance:
    """The same of motions (n, 4, 4), a few at a time, as each moves so many points."""
    step = max(1, _MOST // count)
    return lambda motions: np.concatenate([
        distance(motions[first:first + step]) for first in range(0, len(motions), step)])


def transformed(poses: NDArray[np.floating], points: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n, m, 3) points (m, 3) at each of the poses (n, 4, 4)."""
    return np.asarray(points @ poses[:, :3, :3].swapaxes(1, 2) + poses[:, None, :3, 3], float)
