"""A gripper with two parallel fingers, as boxes."""

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.geometry.se3 import inverse, transform
from pmcl_ros.runtime.settings import Settings


class GripperSettings(Settings):
    """Sizes of a parallel gripper; the defaults are those of a Fetch.

    The grasp frame lies between the fingers: x is the approach, from the wrist to the fingertips,
    y the direction in which the fingers close, z = x cross y. It is the Fetch's gripper_link. The
    lengths between its links are those of its URDF (fetch_description); those of the fingers and
    the palm are rounded up.
    """

    parent_link: str = Field('wrist_roll_link', min_length=1, description='the link whose poses '
                             'are published: the parent of the end effector, as MoveIt wants it')
    parent_to_grasp: tuple[float, float, float] = Field(
        (0.16645, 0.0, 0.0), description='the grasp frame in the parent link [m]')
    parent_to_grasp_rpy: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description='its roll, pitch, yaw, as in URDF [rad]')
    opening: float = Field(0.10, gt=0, description='largest gap between the fingers [m]')
    finger_length: float = Field(0.060, gt=0, description='from the palm to the fingertips [m]')
    finger_width: float = Field(0.026, gt=0, description='of a finger along z [m]')
    finger_thickness: float = Field(0.016, gt=0, description='of a finger along y [m]')
    tip: float = Field(0.029, gt=0, description='from the grasp frame to the fingertips [m]')
    palm_width: float = Field(0.13, gt=0, description='of the palm along y [m]')
    palm_height: float = Field(0.08, gt=0, description='of the palm along z, with what is mounted '
                               'on it [m]')
    palm_length: float = Field(0.12, gt=0, description='of the palm along x [m]')
    friction: float = Field(0.2, gt=0, description='coefficient that is counted on: walls that '
                            'lean more slip out of the fingers')
    contact: float = Field(0.005, ge=0, description='least height of the wall, along a finger or '
                           'across it, that is touched (within 1 mm) [m]')
    margin: float = Field(0.003, ge=0, description='least room on each side of the object [m]')

    @property
    def palm(self) -> float:
        """Where on x the palm ends and the fingers begin [m]."""
        return self.tip - self.finger_length

    @property
    def parent_pose(self) -> NDArray[np.float64]:
        """(4, 4) the parent link in the grasp frame."""
        return inverse(transform(self.parent_to_grasp, self.parent_to_grasp_rpy))

    def boxes(self, opening: float) -> NDArray[np.float64]:
        """(3, 2, 3) lower and upper corners of both fingers and the palm, in the grasp frame [m].

        opening: gap between the fingers [m].
        """
        inner, outer = opening / 2, opening / 2 + self.finger_thickness
        half, high = self.finger_width / 2, self.palm_height / 2
        return np.array([
            [[self.palm, inner, -half], [self.tip, outer, half]],
            [[self.palm, -outer, -half], [self.tip, -inner, half]],
            [[self.palm - self.palm_length, -self.palm_width / 2, -high],
             [self.palm, self.palm_width / 2, high]]])

    def corners(self, opening: float) -> NDArray[np.float64]:
        """(3, 8, 3) all corners of `boxes`."""
        boxes = self.boxes(opening)
        which = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing='ij'), -1).reshape(-1, 3)
        return np.take_along_axis(boxes, which[None], axis=1)
