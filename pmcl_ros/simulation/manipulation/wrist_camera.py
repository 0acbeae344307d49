"""A camera on a simulated wrist: where it is, and where the robot believes it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import retract, transform
from pmcl_ros.simulation.scenes.poses import Pose

# In wrist_roll_link: it looks along x, past the fingers, its picture's upper side towards z.
MOUNT = transform((0.0, 0.0, 0.1), (-np.pi / 2, 0.0, -np.pi / 2))
_HAND_EYE = 0.001, np.deg2rad(0.2)  # standard deviation on each axis [m], about each [rad]
_ENCODER = 1.5e-4  # rad: of a joint's angle


@dataclass(frozen=True)
class WristCamera:
    """mount: (4, 4), the camera's optical frame in wrist_roll_link, where it really is.

    It is off MOUNT, which the robot knows, by the error of a hand-eye calibration.
    """

    mount: NDArray[np.float64]

    @classmethod
    def draw(cls, rng: np.random.Generator) -> 'WristCamera':
        """Off by 1 mm on each axis and 0.2 degrees about each (standard deviations)."""
        shift, turn = _HAND_EYE
        step = np.concatenate([rng.normal(0, shift, 3), rng.normal(0, turn, 3)])
        return cls(np.asarray(retract(MOUNT[None], step[None])[0]))

    def seen_from(self, wrist: Pose) -> Pose:
        """(4, 4) where it is, for the true pose of wrist_roll_link."""
        return np.asarray(wrist @ self.mount)

    @staticmethod
    def reported(wrist: Pose) -> Pose:
        """(4, 4) where the robot believes it is, for the pose that its encoders give."""
        return np.asarray(wrist @ MOUNT)


def read_joints(rng: np.random.Generator, joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """What encoders read of true angles [rad]: noise of 0.15 mrad."""
    return joints + rng.normal(0, _ENCODER, joints.shape)
