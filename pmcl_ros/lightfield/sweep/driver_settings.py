"""What sweep_driver is told."""

from typing import Literal

from pydantic import Field

from pmcl_ros.lightfield.sweep.settings import SweepSettings


class SweepDriverSettings(SweepSettings):
    """Images and poses -> LightField."""

    plan: str = Field('', description='a plan, YAML (pmcl sweep plan): its grid goes over rows, '
                      'columns and baseline; empty: these, where most views have a frame')
    poses: Literal['auto', 'tf', 'topic'] = Field(
        'auto', description='where the camera is: /tf, or the topic camera_pose (PoseStamped); '
        'auto: tf where tf2_ros is installed, else topic')
    fixed_frame: str = Field('base_link', min_length=1, description='in which it is told')
    camera_frame: str = Field('', description="the camera's optical frame on /tf; empty: that of "
                              'the images')
    mount_position: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="the camera's optical frame in what camera_pose tells the "
        'pose of [m]')
    mount_rpy: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description='its roll, pitch, yaw as in URDF [rad]')
    gap: float = Field(0.2, gt=0, le=100, description='longest time between two poses that are '
                       'interpolated [s]')
    patience: float = Field(2.0, gt=0, le=100, description='how long an image waits for its pose '
                            'and for camera_info [s]')
    rectified: bool = Field(False, description='the images are rectified already (image_rect): '
                            'P of camera_info is their camera')
    reliable: bool = Field(True, description='ask for images reliably; false: best effort, for '
                           'cameras that offer no more')
    at_once: bool = Field(True, description='collect as soon as the node is active, not first on '
                          '~/start')
    auto_finish: bool = Field(True, description='publish as soon as every view of the grid is '
                              'there, not first on ~/finish')
