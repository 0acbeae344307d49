"""Error of a pose against the truth, and when a pose counts as right.

Zhou et al. ("the paper"), section VI.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.symmetry import Symmetry

# A pose with smaller errors is right in all studies: a gripper still takes the object there.
RIGHT_DISTANCE, RIGHT_ANGLE = 0.02, np.deg2rad(10)  # m, rad
RIGHT_BOUNDS = 1e3 * RIGHT_DISTANCE, float(np.rad2deg(RIGHT_ANGLE))  # mm, degrees


@dataclass(frozen=True)
class PoseError:
    """How far a pose is from the truth.

    translation: distance of the origins [m].
    rotation: angle between the axes of symmetry, or of the whole rotation without one [rad].
    ray: signed error along the line of sight to the truth [m], positive: too far.
    """

    translation: float
    rotation: float
    ray: float

    @property
    def right(self) -> bool:
        """Whether both errors are small (`is_right`)."""
        return is_right(self.translation, self.rotation)

    @property
    def flipped(self) -> bool:
        """Upside down (beyond 90 degrees), which the paper forgives and a grasp may not."""
        return self.rotation > np.pi / 2

    @property
    def dot(self) -> float:
        """The paper's rotation error: the dot product of the axes, -1 to 1.

        Its absolute value is the same for a flipped object and an upright one. Without an axis of
        symmetry: the cosine of the whole rotation.
        """
        return float(np.cos(self.rotation))


def is_right(translation: float, rotation: float) -> bool:
    """Whether errors [m], [rad] are below `RIGHT_DISTANCE` and `RIGHT_ANGLE`."""
    return translation < RIGHT_DISTANCE and rotation < RIGHT_ANGLE


def pose_error(pose: NDArray[np.float64], truth: NDArray[np.float64], symmetry: Symmetry
               ) -> PoseError:
    """The error of a pose (4, 4) against the equivalent of the truth (4, 4) nearest in rotation.

    pose, truth: object to camera [m]. symmetry: of the object.
    """
    return min((_error(pose, each, symmetry.axis) for each in symmetry.equivalents(truth)),
               key=lambda each: each.rotation)


def _error(pose: NDArray[np.float64], truth: NDArray[np.float64],
           axis: NDArray[np.float64] | None) -> PoseError:
    shift = pose[:3, 3] - truth[:3, 3]
    if axis is None:
        angle = float(Rotation.from_matrix(pose[:3, :3] @ truth[:3, :3].T).magnitude())
    else:
        first, second = pose[:3, :3] @ axis, truth[:3, :3] @ axis
        angle = float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))
    ray = truth[:3, 3] / max(float(np.linalg.norm(truth[:3, 3])), 1e-12)
    return PoseError(float(np.linalg.norm(shift)), angle, float(shift @ ray))
