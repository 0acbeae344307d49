"""Parameters of tracking, beside those of the search."""

from typing import Literal

from pydantic import Field, model_validator

from pmcl_ros.pmcl.settings import PmclSettings

Tracking = Literal['none', 'constant_pose', 'constant_velocity', 'camera']


class TrackingSettings(PmclSettings):
    """How an object is followed from capture to capture."""

    tracking: Tracking = Field(
        'none', description='none: each capture is searched by itself. Else the search starts '
        'from the predicted pose, by this action model: constant_pose, the object rests before '
        'the camera; constant_velocity, it keeps its velocity; camera, it rests in the fixed '
        'frame and the camera moves')
    track_sigma_translation: float = Field(
        0.01, gt=0, le=1, description='tracking: standard deviation of the process noise '
        'after track_period, along x, y, z; grows as the square root of time [m]')
    track_sigma_rotation: float = Field(
        0.06, gt=0, le=3, description='tracking: the same about x, y, z [rad]')
    track_period: float = Field(
        0.1, gt=0, le=3600, description='tracking: time for which both standard deviations '
        'hold, such as the time between two captures [s]')
    track_particles: int = Field(64, ge=16, le=10_000, description='tracking: particles')
    track_candidates: int = Field(
        1024, ge=16, le=100_000, description='tracking: poses drawn around the prediction with '
        'which the search of a capture starts')
    track_check: int = Field(
        10, ge=0, le=100_000, description='tracking: number of followed captures after which '
        'the whole region is searched too, in case something else is followed. The next such '
        'search comes after twice as many, and so on, or when the evidence is weaker than usual; '
        '0: never')
    track_camera: Literal['auto', 'topic', 'tf'] = Field(
        'auto', description='tracking camera: source of the pose of the camera: topic, '
        'PoseStamped of the optical frame on camera_pose; tf, /tf; auto, tf where tf2_ros is '
        'installed')
    track_frame: str = Field(
        'odom', description='tracking camera: the fixed frame, in which the object rests')
    track_max_age: float = Field(
        0.1, gt=0, le=60, description='tracking camera: largest time between a capture and '
        'a pose of camera_pose [s]')

    @model_validator(mode='after')
    def _tracks_contours(self) -> 'TrackingSettings':
        if self.tracking != 'none' and self.mode != 'default':
            raise ValueError(f'tracking {self.tracking} needs mode default, it is {self.mode}: '
                             'set tracking none, or mode default')
        return self
