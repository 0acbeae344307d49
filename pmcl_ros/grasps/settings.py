"""What grasp_node is told."""

from typing import Annotated, Literal

from pydantic import Field

from pmcl_ros.runtime.settings import Settings

_HALF_TURN = 1.5707963267948966
_Length = Annotated[float, Field(gt=0)]


class GraspSettings(Settings):
    """Where the camera and the robot are, and which grasps are good enough."""

    grasps: str = Field('', description="the object's grasps, YAML (pmcl grasps)")
    base_frame: str = Field('base_link', min_length=1, description='in which grasps are told')
    camera_frame: str = Field('lytro_optical_frame', min_length=1,
                              description='in which the poses of the object come')
    arm: Literal['auto', 'tf', 'topic', 'fixed'] = Field(
        'auto', description="where the arm is at the shutter's time: /tf, the topic arm_pose "
        '(PoseStamped of mount_parent in base_frame), or not at all: the camera is fixed to '
        'base_frame; auto: tf where tf2_ros is installed, else topic')
    mount_parent: str = Field('wrist_roll_link', min_length=1,
                              description='the link that the camera is fixed to')
    mount_position: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.08), description="the camera's optical frame in mount_parent [m]; measure "
        'yours')
    mount_rpy: tuple[float, float, float] = Field(
        (-_HALF_TURN, 0.0, -_HALF_TURN), description='its roll, pitch, yaw as in URDF [rad]; the '
        'default looks along x of mount_parent, its z up')
    max_age: float = Field(0.1, gt=0, description="how far the arm's pose may be from the "
                           "capture's time [s]")
    arm_sigma: float = Field(0.002, ge=0, description='standard deviation of where the arm puts '
                             'the gripper, and of the mount, on each axis [m]')
    assumed_sigma: tuple[_Length, _Length] = Field(
        (0.005, 0.05), description='standard deviation of a pose that comes without its '
        'covariance: position on each axis [m], rotation about each [rad]')
    least_probability: float = Field(
        0.9, ge=0, le=1, description='grasps whose open fingers clear the object less surely are '
        'refused')
    turns: int = Field(24, ge=1, le=360, description='angles about an axis of symmetry that are '
                       'looked at')
    most: int = Field(32, ge=1, le=1000, description='grasps that are told for a pose, the best')
    approach: float = Field(0.10, gt=0, description='of the straight way to the grasp [m]')
    shoulder: tuple[float, float, float] = Field(
        (0.033, 0.0, 0.786), description="where the arm begins, in base_frame [m]; a Fetch's with "
        'its torso down')
    wrist: float = Field(0.1385, ge=0, description='from the centre of the wrist, along the '
                         "approach, to the gripper's parent link [m]")
    nearest: float = Field(0.15, ge=0, description='least distance of the wrist from the shoulder '
                           '[m]')
    reach: float = Field(0.79, gt=0, description='largest distance of the wrist from the shoulder '
                         '[m]')
    support: bool = Field(True, description='the object stands on something at its lowest point: '
                          'the gripper stays above that')
    support_margin: float = Field(0.005, description='how far above [m]')
    localizer: str = Field('pmcl_node', description='the node whose /diagnostics say that the '
                           'object is lost; empty: none')
