"""Parameters of tracking: those of the search, and how the object moves."""

from typing import Literal

from pydantic import Field, model_validator

from pmcl_ros.pmcl.settings import PmclSettings

Tracking = Literal['none', 'constant_pose', 'constant_velocity', 'camera']


class TrackingSettings(PmclSettings):
    """EdgeVolume after EdgeVolume -> PoseEstimate after PoseEstimate."""

    tracking: Tracking = Field(
        'none', description='none: every capture is searched by itself. Else the search starts '
        'from where the object was, moved as it is said to move: constant_pose, it rests before '
        'the camera; constant_velocity, it goes on as between the last two captures; camera, it '
        'rests in the fixed frame, and the camera moves')
    track_sigma_translation: float = Field(
        0.01, gt=0, le=1, description='tracking: standard deviation of what the motion model '
        'leaves open after track_period, along x, y, z; grows as the square root of time [m]')
    track_sigma_rotation: float = Field(
        0.06, gt=0, le=3, description='tracking: likewise about x, y, z [rad]')
    track_period: float = Field(
        0.1, gt=0, le=3600, description='tracking: time that these standard deviations are of, as '
        'between two captures [s]')
    track_particles: int = Field(64, ge=16, le=10_000, description='tracking: particles')
    track_candidates: int = Field(
        1024, ge=16, le=100_000, description='tracking: poses drawn around the predicted one, by '
        'which each capture is first looked at')
    track_check: int = Field(
        10, ge=0, le=100_000, description='tracking: after so many captures that were followed '
        'the whole region is searched as well, lest something else was taken for the object; '
        'then after twice as many, and so on, and when it has less evidence than usual; 0: never')
    track_camera: Literal['auto', 'topic', 'tf'] = Field(
        'auto', description='tracking camera: where the pose of the camera is from: topic, '
        'PoseStamped of the optical frame on camera_pose; tf, /tf; auto, tf where tf2_ros is '
        'installed')
    track_frame: str = Field(
        'odom', description='tracking camera: the fixed frame that the camera moves in, and the '
        'object rests in')
    track_max_age: float = Field(
        0.1, gt=0, le=60, description='tracking camera: how far from a capture a pose of '
        'camera_pose may be [s]')

    @model_validator(mode='after')
    def _tracks_contours(self) -> 'TrackingSettings':
        if self.tracking != 'none' and self.mode != 'default':
            raise ValueError(f'tracking {self.tracking} needs mode default, it is {self.mode}: '
                             'set tracking none, or mode default')
        return self
