"""Fields that the settings of ordinary cameras, of posed views and of sweeps share."""

from typing import Annotated

from pydantic import Field

Compressed = Annotated[bool, Field(description='take CompressedImage (JPEG, PNG), from '
                                   'image/compressed')]
Rectified = Annotated[bool, Field(description='the images are rectified (image_rect): P of '
                                  'camera_info applies')]
Reliable = Annotated[bool, Field(description='subscribe to images reliably; false: best effort, '
                                 'for cameras that offer no more')]
Shrink = Annotated[int, Field(ge=1, le=32, description='side of the squares of pixels that are '
                              'averaged to one [px]')]
Gamma = Annotated[float, Field(ge=0.1, le=10, description="exponent that linearises the images' "
                               'values; 1: they are linear')]
SigmaPosition = Annotated[float, Field(ge=0, le=1, description='posed views: standard deviation '
                                        "of the position of a camera's pose, on each axis [m]")]
SigmaRotation = Annotated[float, Field(
    ge=0, le=3, description="posed views: standard deviation of the rotation of a camera's pose, "
    'about each axis [rad]')]
Common = Annotated[float, Field(
    ge=0, le=1, description='posed views: share of these variances that all views have in common, '
    'for example by an error of the hand-eye transform, or because fixed cameras were calibrated '
    'together and then to the robot [1]')]
