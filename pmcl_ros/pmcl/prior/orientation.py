"""Which orientations an object may have: the angle between its axis and a direction."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import least_turn
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings

_ROUNDING = 1e-7  # rad: the arc cosine of 1 less its rounding is 2e-8


@dataclass(frozen=True)
class Orientation:
    """Orientations of an object whose axis is at an angle to a direction: the prior on SO(3).

    axes: (k, 3) unit vectors in the frame of the object, which its symmetries make one.
    direction: (3,) unit vector in the frame of the poses. least, most: angle between both [rad].
    """

    axes: NDArray[np.float64]
    direction: NDArray[np.float64]
    least: float
    most: float

    @classmethod
    def from_settings(cls, settings: PmclSettings, model: ObjectModel) -> 'Orientation | None':
        """In the frame of the region of interest; None where any orientation is possible.

        The axis is `ObjectModel.up`.
        """
        if not settings.is_oriented:
            return None
        axes = model.symmetry.discrete[:, :3, :3] @ model.up
        up = np.array(settings.roi_up)
        return cls(axes, up / np.linalg.norm(up), *settings.roi_tilt)

    def seen_from(self, camera: NDArray[np.float64]) -> 'Orientation':
        """In the frame of a camera, whose pose (4, 4) is in this one's frame."""
        return replace(self, direction=self.direction @ camera[:3, :3])

    def allows(self, rotations: NDArray[np.floating], slack: float = 0.0) -> NDArray[np.bool_]:
        """(n,) which of rotations (n, 3, 3) are possible, or are off by less than a slack [rad].

        By any of the equivalent ones.
        """
        return self.allows_seen(rotations, self.direction[None], slack)[:, 0]

    def allows_seen(self, rotations: NDArray[np.floating], directions: NDArray[np.float64],
                    slack: float) -> NDArray[np.bool_]:
        """(n, m) which of rotations (n, 3, 3) are possible with other directions (m, 3)."""
        cosines = np.tensordot(rotations @ self.axes.T, directions, (1, 1))
        angles = np.arccos(np.clip(cosines, -1, 1))
        return np.asarray(((angles >= self.least - slack - _ROUNDING)
                           & (angles <= self.most + slack + _ROUNDING)).any(axis=1))

    def clip(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rotations (n, 3, 3), those that are not possible turned as little as makes them so."""
        axes = rotations @ self.axes.T
        angles = np.arccos(np.clip(np.tensordot(axes, self.direction, (1, 0)), -1, 1))
        turns = np.clip(angles, self.least, self.most) - angles
        nearest = np.abs(turns).argmin(axis=1)
        row = np.arange(len(rotations))
        about = np.cross(self.direction, axes[row, :, nearest])
        length = np.linalg.norm(about, axis=1, keepdims=True)
        across = np.cross(self.direction, np.eye(3)[np.abs(self.direction).argmin()])
        about = np.where(length > _ROUNDING, about / np.maximum(length, _ROUNDING),
                         across / np.linalg.norm(across))
        return np.asarray(Rotation.from_rotvec(turns[row, nearest, None] * about).as_matrix()
                          @ rotations)

    def draw(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """(count, 3, 3) rotations, uniform over those that are possible."""
        spin, heading = rng.uniform(0, 2 * np.pi, (2, count))
        tilt = np.arccos(rng.uniform(np.cos(self.most), np.cos(self.least), count))
        turned = Rotation.from_euler('ZYZ', np.stack([heading, tilt, spin], axis=1))
        z = np.array([0, 0, 1.0])
        return np.asarray((least_turn(z, self.direction) * turned
                           * least_turn(self.axes[0], z)).as_matrix())
