"""Parameters of grasps: sizes of the gripper, and those of grasp_node."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.geometry.se3 import inverse, transform
from pmcl_ros.runtime.settings import Settings

_QUARTER_TURN = 1.5707963267948966  # rad
_Length = Annotated[float, Field(gt=0)]


class GripperSettings(Settings):
    """Sizes of a gripper with two parallel fingers, as boxes; by default those of a Fetch.

    The grasp frame lies between the fingers: x is the approach, from the wrist to the fingertips,
    y the direction in which the fingers close, z = x cross y. It is the Fetch's gripper_link. The
    lengths between the links are those of the URDF (fetch_description); those of the fingers and
    of the palm are rounded up.
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
    palm_height: float = Field(0.08, gt=0, description='of the palm along z, with parts mounted '
                               'on it [m]')
    palm_length: float = Field(0.12, gt=0, description='of the palm along x [m]')
    friction: float = Field(0.2, gt=0, description='assumed coefficient: walls that lean more '
                            'slip out of the fingers')
    contact: float = Field(0.005, ge=0, description='least height of the wall, along a finger or '
                           'across it, that is touched (within 1 mm) [m]')
    margin: float = Field(0.003, ge=0, description='least room on each side of the object [m]')

    @property
    def palm(self) -> float:
        """x at which the palm ends and the fingers begin [m]."""
        return self.tip - self.finger_length

    @property
    def parent_pose(self) -> NDArray[np.float64]:
        """(4, 4) pose of the parent link in the grasp frame."""
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


class GraspSettings(Settings):
    """Parameters of grasp_node: mount of the camera, arm, acceptance of grasps."""

    grasps: str = Field('', description="the object's grasps, YAML (pmcl grasps)")
    base_frame: str = Field('base_link', min_length=1, description='frame of the published grasps')
    camera_frame: str = Field('lytro_optical_frame', min_length=1,
                              description='frame of the received poses of the object')
    arm: Literal['auto', 'tf', 'topic', 'fixed'] = Field(
        'auto', description="source of the arm's pose at the shutter's time: tf, /tf; topic, "
        'arm_pose (PoseStamped of mount_parent in base_frame); fixed, the camera is fixed to '
        'base_frame; auto, tf where tf2_ros is installed, else topic')
    mount_parent: str = Field('wrist_roll_link', min_length=1,
                              description='the link that the camera is fixed to')
    mount_position: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.08), description="the camera's optical frame in mount_parent [m]; measure "
        'yours')
    mount_rpy: tuple[float, float, float] = Field(
        (-_QUARTER_TURN, 0.0, -_QUARTER_TURN), description='its roll, pitch, yaw as in URDF '
        '[rad]; the default looks along x of mount_parent, its z up')
    max_age: float = Field(0.1, gt=0, description='largest time between a capture and a pose '
                           'of the arm [s]; tf2 interpolates over any')
    arm_sigma: float = Field(0.002, ge=0, description='standard deviation of the position of the '
                             'gripper, from arm and mount, on each axis [m]')
    assumed_sigma: tuple[_Length, _Length] = Field(
        (0.005, 0.05), description='standard deviation of a pose that comes without its '
        'covariance: position on each axis [m], rotation about each [rad]')
    least_probability: float = Field(
        0.9, ge=0, le=1, description='least probability that the open fingers clear the object; '
        'other grasps are refused')
    turns: int = Field(24, ge=1, le=360, description='angles about an axis of symmetry that are '
                       'tried')
    most: int = Field(32, ge=1, le=1000, description='largest number of grasps that are published')
    approach: float = Field(0.10, gt=0, description='length of the straight approach [m]')
    shoulder: tuple[float, float, float] = Field(
        (0.033, 0.0, 0.786), description="first joint of the arm, in base_frame [m]; a Fetch's "
        'with its torso down')
    wrist: float = Field(0.1385, ge=0, description='from the centre of the wrist, along the '
                         "approach, to the gripper's parent link [m]")
    nearest: float = Field(0.15, ge=0, description='least distance of the wrist from the shoulder '
                           '[m]')
    reach: float = Field(0.79, gt=0, description='largest distance of the wrist from the shoulder '
                         '[m]')
    support: bool = Field(True, description='the object stands on a surface at its lowest '
                          'point: the gripper stays above it')
    support_margin: float = Field(0.005, description='least distance above it [m]')
    localizer: str = Field('pmcl_node', description='node whose /diagnostics report that the '
                           'object is lost; empty: none')
