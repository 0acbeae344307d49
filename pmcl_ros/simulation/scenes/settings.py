"""What kinds of scenes are made, and how they are photographed."""

from typing import Literal, get_args

from pydantic import Field, field_validator

from pmcl_ros.runtime.settings import Settings

Kind = Literal['glass', 'opaque', 'glass film', 'opaque film', 'glass block', 'opaque block',
               'glass block film', 'opaque block film']
KINDS: tuple[Kind, ...] = get_args(Kind)


class SceneSettings(Settings):
    """Of `random_scene`."""

    kinds: tuple[Kind, ...] = Field(
        ('glass', 'glass', 'opaque', 'glass film', 'opaque film', 'opaque film'), min_length=1,
        description='kinds of scenes, one of which is drawn: glass or opaque, vessels or blocks '
        'with sharp edges, with or without a translucent film before everything')
    empty: float = Field(0.1, ge=0, le=1, description='share of scenes without their object')
    targets: int = Field(1, ge=1, le=8, description='things to look for in a scene')
    outside: float = Field(0.15, ge=0, le=1,
                           description='share of scenes whose object reaches beyond the image')
    clutter: int = Field(5, ge=0, le=20, description='other things at most')
    near: float = Field(0.4, ge=0.15, le=5, description='least distance of the object [m]')
    far: float = Field(0.75, ge=0.15, le=5, description='largest distance of the object [m]')
    roi: float = Field(0.16, gt=0, le=2,
                       description="side of the box that holds the object's origin [m]")
    views: int = Field(7, ge=3, le=31, description='side of the square of views, odd [views]')
    size: int = Field(328, ge=16, le=2000, description='side of a view [px]')
    field: float = Field(0.347, gt=0.02, le=1.5,
                         description="field of view: the image's side over the focal length [1]; "
                         "the camera's own varies by a tenth about it")
    noise: float = Field(1.0, ge=0, le=20, description='noise: standard deviation in units of '
                         'that of an F01 at ISO 80 in a lit room; 0: none')

    @field_validator('views')
    @classmethod
    def _odd(cls, value: int) -> int:
        if value % 2 == 0:
            raise ValueError('must be odd, to have a centre')
        return value
