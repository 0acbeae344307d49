"""Errors of a pose against the truth, as the paper counts them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class PoseError:
    """How far a pose is from the truth.

    translation: distance of the origins [m].
    rotation: between the axes of symmetry, or of the whole rotation where there is none [rad].
    ray: signed error along the line of sight to the truth [m], positive: too far.
    """

    translation: float
    rotation: float
    ray: float

    @property
    def flipped(self) -> bool:
        """Upside down (beyond 90 degrees), which the paper forgives and a grasp may not."""
        return self.rotation > np.pi / 2

    @property
    def dot(self) -> float:
        """The paper's rotation error: the dot product of the axes, -1 to 1.

        Its absolute value does not tell a flipped object from an upright one. Without an axis of
        symmetry: the cosine of the whole rotation.
        """
        return float(np.cos(self.rotation))


def pose_error(pose: NDArray[np.floating], truth: NDArray[np.floating],
               axis: NDArray[np.floating] | None,
               discrete: NDArray[np.floating] | None = None) -> PoseError:
    """The error of a pose (paper, section VI).

    pose, truth: (4, 4), object to camera. axis: (3,) of symmetry, in the object's frame, if any.
    discrete: (n, 4, 4) what else leaves the object as it is, the identity included; of the truths
    that are alike, the one of the least rotation error counts.
    """
    truths = truth[None] if discrete is None else truth @ discrete
    return min((_error(pose, each, axis) for each in truths), key=lambda each: each.rotation)


def _error(pose: NDArray[np.floating], truth: NDArray[np.floating],
           axis: NDArray[np.floating] | None) -> PoseError:
    shift = pose[:3, 3] - truth[:3, 3]
    if axis is None:
        angle = float(Rotation.from_matrix(pose[:3, :3] @ truth[:3, :3].T).magnitude())
    else:
        first, second = pose[:3, :3] @ axis, truth[:3, :3] @ axis
        angle = float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))
    ray = truth[:3, 3] / np.linalg.norm(truth[:3, 3])
    return PoseError(float(np.linalg.norm(shift)), angle, float(shift @ ray))
