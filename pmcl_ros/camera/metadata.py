"""The camera's metadata: the JSON text beside every raw picture, as a checked value."""

import json
from functools import cached_property
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pmcl_ros.errors import CameraError
from pmcl_ros.settings import explain

_Level = Annotated[int, Field(ge=0, le=4095)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra='ignore', allow_inf_nan=False)


class _Levels(_Part):
    r: _Level
    gr: _Level
    gb: _Level
    b: _Level


class _PixelFormat(_Part):
    black: _Levels
    white: _Levels

    @model_validator(mode='after')
    def _ordered(self) -> '_PixelFormat':
        black, white = self.black, self.white
        if max(black.r, black.gr, black.gb, black.b) >= min(white.r, white.gr, white.gb, white.b):
            raise ValueError('black levels must be below the white levels')
        return self


class _Mosaic(_Part):
    tile: str
    upperLeftPixel: str


class _RawDetails(_Part):
    pixelFormat: _PixelFormat
    mosaic: _Mosaic


class _Gains(_Part):
    r: float = Field(gt=0)
    gr: float = Field(gt=0)
    gb: float = Field(gt=0)
    b: float = Field(gt=0)


class _Color(_Part):
    ccmRgbToSrgbArray: tuple[float, float, float, float, float, float, float, float, float]
    gamma: float = Field(gt=0, le=1)
    whiteBalanceGain: _Gains


class _Image(_Part):
    width: int = Field(gt=0, le=8192)
    height: int = Field(gt=0, le=8192)
    rawDetails: _RawDetails
    color: _Color


class _Frame(_Part):
    image: _Image


class _Camera(_Part):
    serialNumber: str = ''


class _Private(_Part):
    camera: _Camera = _Camera()


class CameraMetadata(BaseModel):
    """What the decode needs of the camera's JSON (lytro_f01.md, B3); `text` keeps all of it."""

    model_config = ConfigDict(frozen=True)

    text: str
    image: _Image
    serial: str = ''

    @classmethod
    def parse(cls, text: str) -> 'CameraMetadata':
        """Read the camera's JSON: the whole .TXT (master.picture...), or a frame's part alone.

        Raises CameraError naming the missing or impossible field.
        """
        try:
            frame, private = _frame_of(json.loads(text))
            return cls(text=text, image=_Frame.model_validate(frame).image,
                       serial=_Private.model_validate(private).camera.serialNumber)
        except ValidationError as error:
            raise CameraError(f'metadata: {explain(error)}') from None
        except (ValueError, RecursionError) as error:
            raise CameraError(f'metadata is not JSON ({error}); is this the .TXT that belongs to '
                              'the .RAW?') from None

    @cached_property
    def black(self) -> float:
        """Black level, counts (mean over the four phases; an F01 says 168 for all)."""
        levels = self.image.rawDetails.pixelFormat.black
        return (levels.r + levels.gr + levels.gb + levels.b) / 4

    @cached_property
    def white(self) -> float:
        """White level, counts."""
        levels = self.image.rawDetails.pixelFormat.white
        return min(levels.r, levels.gr, levels.gb, levels.b)


def _frame_of(data: Any) -> tuple[Any, Any]:
    """The metadata and the private metadata of the picture's frame."""
    if not isinstance(data, dict) or 'master' not in data:
        return data, {}  # what is no object is refused with the fields of one
    frame = data
    for step in ('master', 'picture', 'frameArray', 0, 'frame'):
        try:
            frame = frame[step]
        except (KeyError, IndexError, TypeError):
            raise CameraError(f'metadata has no {step!r} on the way to the frame, master.picture.'
                              'frameArray[0].frame; is this the .TXT of a camera?') from None
    if not isinstance(frame, dict) or 'metadata' not in frame:
        raise CameraError("metadata has no 'metadata' in its frame; is this the .TXT of a camera?")
    return frame['metadata'], frame.get('privateMetadata', {})
