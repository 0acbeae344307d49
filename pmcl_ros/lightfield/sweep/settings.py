"""Parameters of sweeps and of the node that collects them."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pmcl_ros.lightfield.readers.pictures import Bits
from pmcl_ros.lightfield.sweep.plan import BASELINES
from pmcl_ros.lightfield.view_fields import (
    Common,
    Compressed,
    Gamma,
    Rectified,
    Reliable,
    Shrink,
    SigmaPosition,
    SigmaRotation,
)
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import Settings


class SweepSettings(Settings):
    """The grid of views, and which frames are good enough for it."""

    rows: int = Field(5, ge=1, le=99, description='rows of views [views]')
    columns: int = Field(5, ge=1, le=99, description='views of a row [views]')
    baseline: float = Field(0.025, ge=BASELINES[0], le=BASELINES[1],
                            description='between neighbouring views [m]')
    near: float = Field(0.3, ge=0.01, le=100, description='smallest depth of interest [m]')
    far: float = Field(0.9, ge=0.01, le=1000, description='largest depth of interest [m]')
    sharpness: float = Field(
        0.5, ge=0, le=1, description='least energy of second derivatives, horizontal or vertical, '
        "as a share of the frames' median; frames below are blurred [1]")
    brightness: float = Field(
        0.25, gt=0, le=10, description="largest relative difference of a frame's mean from the "
        "frames' median [1]")
    exposure: float = Field(0.01, ge=0, le=10, description='exposure time of a frame, '
                            'including the readout of a rolling shutter [s]')
    movement: float = Field(1.0, gt=0, le=100, description='largest image motion of points at '
                            'near during the exposure [px]')
    plane: float = Field(
        0.5, gt=0, le=100, description="largest error of a view off the grid's plane, in the "
        'corners at near and far; it is scaled to be exact between them [px]')
    overlap: float = Field(0.6, gt=0, le=1, description="least share of the reference view's "
                           'picture in another view [1]')
    residual: float = Field(
        1.5, gt=0, le=100, description='largest median distance of tracked corners from the lines '
        "that a view's pose allows [px]")
    shrink: Shrink = 1
    gamma: Gamma = 2.2
    bits: Bits = 16

    @model_validator(mode='after')
    def _possible(self) -> 'SweepSettings':
        if self.near >= self.far:
            raise ValueError(f'near {self.near} m must be smaller than far {self.far} m')
        if self.rows * self.columns < 2:
            raise ValueError('one view alone is no light field; give two or more')
        return self

    @property
    def focus(self) -> float:
        """Depth [m] in the middle between near and far, in disparity."""
        return 2 / (1 / self.near + 1 / self.far)


class ViewSettings(SweepSettings):
    """Which frames of a camera that looks from anywhere become posed views."""

    apart: float = Field(0.03, gt=0, le=10, description='posed views: smallest distance of two '
                         'views; a rotation counts by its motion at near [m]')
    least_views: int = Field(2, ge=1, le=99, description='posed views: published from this number '
                             'of views on, then after each view')
    most_views: int = Field(12, ge=1, le=99, description='posed views: the collection ends with '
                            'this number of views; where drift is set the oldest goes instead')
    mask: str = Field('', description='posed views: path of a picture of the size of the images, '
                      'black where they show what moves with the camera, as a gripper; empty: '
                      'nowhere')
    sigma_position: SigmaPosition = 0.001
    sigma_rotation: SigmaRotation = 0.0035
    common: Common = 0.5
    drift: float = Field(
        0.0, ge=0, le=1, description='posed views: standard deviation of the velocity of an '
        'object that does not rest, on each axis. The pose is that at the last view; earlier '
        'views count as less certain, by their age [m/s]')


class SweepDriverSettings(ViewSettings):
    """Images and poses -> LightField or PosedViews."""

    collect: Literal['grid', 'rest', 'service', 'plan'] = Field(
        'grid', description='grid: parallel views on a plane, published as a light field (views); '
        'rest: a posed view wherever the camera comes to rest (posed_views); service: one for '
        'each call of ~/take; plan: one at each pose of the plan')
    plan: str = Field('', description='path of a plan, YAML. Where collect is grid: a plan of '
                      'pmcl sweep plan, which replaces rows, columns and baseline; empty: a grid '
                      'where most views have a frame. Where collect is plan: `poses`, camera to '
                      'fixed_frame, 16 numbers each; a frame within `apart` of a pose is its view')
    poses: Literal['auto', 'tf', 'topic'] = Field(
        'auto', description='source of camera poses: /tf, or the topic camera_pose (PoseStamped); '
        'auto: tf where tf2_ros is installed, else topic')
    fixed_frame: str = Field('base_link', min_length=1, description='fixed frame of the poses')
    camera_frame: str = Field('', description="the camera's optical frame on /tf; empty: that of "
                              'the images')
    mount_parent: str = Field('', description='of /tf: the link that the camera is fixed to, by '
                              'mount_position and mount_rpy; empty: the camera is on /tf')
    mount_position: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="position of the camera's optical frame in the frame "
        'whose pose camera_pose has, or in mount_parent [m]')
    mount_rpy: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description='its roll, pitch, yaw as in URDF [rad]')
    gap: float = Field(0.2, gt=0, le=100, description='longest time between two interpolated '
                       'poses [s]; tf2 interpolates over any')
    patience: float = Field(5.0, gt=0, le=100, description='longest wait of an image for its pose '
                            'and for camera_info [s]; DDS repeats a message that was lost after 3')
    compressed: Compressed = False
    rectified: Rectified = False
    reliable: Reliable = True
    at_once: bool = Field(True, description='start to collect on activation; false: on ~/start')
    auto_finish: bool = Field(True, description='publish as soon as the grid is complete; false: '
                              'on ~/finish')


def check_mounted(mount: NDArray[np.float64]) -> None:
    """SettingsError where a mount (4, 4) is given and /tf is asked for the camera itself."""
    if not np.allclose(mount, np.eye(4)):
        raise SettingsError('mount_position and mount_rpy place the camera in mount_parent, which '
                            'is empty: set it, or leave them out, as the camera is on /tf')
