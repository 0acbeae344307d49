"""What kinds of sequences are made, and how they are photographed."""

from typing import Literal

from pydantic import Field, field_validator, model_validator

from pmcl_ros.runtime.settings import Settings

Kind = Literal['opaque', 'translucent', 'film']


class SequenceSettings(Settings):
    """Of `Sequence`."""

    kinds: tuple[Kind, ...] = Field(
        ('opaque', 'translucent', 'film'), min_length=1,
        description='kinds of objects, one of which is drawn: opaque; one that lets '
        'light through, with a rim; opaque behind a film that does')
    frames: int = Field(200, ge=1, le=100_000, description='length of the sequence [frames]')
    rate: float = Field(10.0, gt=0, le=1000, description='frames per second [Hz]')
    object_speed: float = Field(
        0.02, ge=0, le=0.1, description='largest motion of the object in its fixed frame from '
        'frame to frame [m]; 0: it rests')
    camera_speed: float = Field(
        0.004, ge=0, le=0.1, description='largest motion of the camera from frame to frame [m]; '
        '0: it rests')
    occluded: int = Field(10, ge=0, le=1000, description='frames, in the middle, in which a card '
                          'before the camera hides all [frames]')
    views: int = Field(3, ge=3, le=9, description='side of the square of views, odd [views]; they '
                       'span what the inner 7x7 of an F01 do')
    size: int = Field(256, ge=32, le=2000, description='side of a view [px]')
    field: float = Field(0.36, gt=0.1, le=1.5,
                         description="field of view: the image's side over the focal length [1]")
    distance: float = Field(0.6, ge=0.3, le=5,
                            description='mean distance of the object from the camera [m]')
    noise: float = Field(1.0, ge=0, le=20, description='noise: standard deviation in units of '
                         'that of an F01 at ISO 80 in a lit room; 0: none')

    @field_validator('views')
    @classmethod
    def _odd(cls, value: int) -> int:
        if value % 2 == 0:
            raise ValueError('must be odd, to have a centre')
        return value

    @model_validator(mode='after')
    def _seen_at_all(self) -> 'SequenceSettings':
        if self.occluded and self.occluded + 2 > self.frames:
            raise ValueError(f'{self.occluded} hidden frames leave none before and after them of '
                             f'{self.frames}: set occluded to {max(self.frames - 2, 0)} at most')
        return self
