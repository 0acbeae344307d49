"""Parameters of sweeps and of the node that collects them."""

from typing import Literal

from pydantic import Field, model_validator

from pmcl_ros.runtime.settings import Settings


class SweepSettings(Settings):
    """The grid of views, and which frames are good enough for it."""

    rows: int = Field(5, ge=1, le=99, description='rows of views [views]')
    columns: int = Field(5, ge=1, le=99, description='views of a row [views]')
    baseline: float = Field(0.025, ge=1e-5, le=10, description='between neighbouring views [m]')
    near: float = Field(0.3, ge=0.01, le=100, description='depth of what is nearest [m]')
    far: float = Field(0.9, ge=0.01, le=1000, description='depth of what is farthest, of what '
                       'matters [m]')
    sharpness: float = Field(
        0.5, ge=0, le=1, description='least energy of second derivatives, across or down, as a '
        "share of the frames' median; less is blurred [1]")
    brightness: float = Field(
        0.25, gt=0, le=10, description="how far a frame's mean may be from the frames' median, as "
        'a share of it [1]')
    exposure: float = Field(0.01, ge=0, le=10, description='time that a frame is exposed for, '
                            'with that of reading a rolling shutter [s]')
    movement: float = Field(1.0, gt=0, le=100, description='how far things at near may move in '
                            'the picture meanwhile [px]')
    plane: float = Field(
        0.5, gt=0, le=100, description='error at near and far, in the corners, that a view off '
        "the grid's plane may have: it is scaled to be right between them [px]")
    overlap: float = Field(0.6, gt=0, le=1, description="least share of the reference view's "
                           'picture that another must show [1]')
    residual: float = Field(
        1.5, gt=0, le=100, description='how far the median of tracked corners may be from where '
        "a view's pose allows them [px]")
    shrink: int = Field(1, ge=1, le=32, description='side of the squares of pixels that become '
                        'one [px]')
    gamma: float = Field(2.2, ge=0.1, le=10, description="exponent that makes the images' values "
                         'linear light; 1: they are')

    @model_validator(mode='after')
    def _possible(self) -> 'SweepSettings':
        if self.near >= self.far:
            raise ValueError(f'near {self.near} m must be smaller than far {self.far} m')
        if self.rows * self.columns < 2:
            raise ValueError('one view alone is no light field; give two or more')
        return self

    @property
    def focus(self) -> float:
        """Depth [m] midway between near and far in disparity."""
        return 2 / (1 / self.near + 1 / self.far)


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
