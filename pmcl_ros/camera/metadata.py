"""The camera's metadata: the JSON text beside every raw picture, as a checked value."""

import json
from functools import cached_property
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pmcl_ros.runtime.errors import CameraError
from pmcl_ros.runtime.settings import explain

_Level = Annotated[int, Field(ge=0, le=4095)]
# Far beyond any camera's, so that nothing overflows.
_Gain = Annotated[float, Field(ge=1e-3, le=1e3)]
_Share = Annotated[float, Field(ge=-1e3, le=1e3)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra='ignore', allow_inf_nan=False)

    @model_validator(mode='before')
    @classmethod
    def _given(cls, data: Any) -> Any:
        """A field of null is one that is not there."""
        if not isinstance(data, dict):
            return data
        return {name: value for name, value in data.items() if value is not None}


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
    tile: str = Field(max_length=100)
    upperLeftPixel: str = Field(max_length=100)


class _RawDetails(_Part):
    pixelFormat: _PixelFormat
    mosaic: _Mosaic


class _Gains(_Part):
    r: _Gain
    gr: _Gain
    gb: _Gain
    b: _Gain


class _Color(_Part):
    ccmRgbToSrgbArray: tuple[_Share, _Share, _Share, _Share, _Share, _Share, _Share, _Share,
                             _Share]
    gamma: float = Field(ge=0.01, le=1)
    whiteBalanceGain: _Gains


class _Image(_Part):
    width: int = Field(gt=0, le=8192)
    height: int = Field(gt=0, le=8192)
    rawDetails: _RawDetails
    color: _Color


class _Offset(_Part):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class _Lens(_Part):
    zoomStep: float | None = None
    focusStep: float | None = None
    exitPupilOffset: _Offset = _Offset()


class _Shutter(_Part):
    frameExposureDuration: float | None = Field(None, ge=0)
    pixelExposureDuration: float | None = Field(None, ge=0)


class _Sensor(_Part):
    pixelPitch: float | None = Field(None, gt=0)


class _Scale(_Part):
    x: float = Field(1.0, gt=0)
    y: float = Field(1.0, gt=0)


class _Mla(_Part):
    lensPitch: float | None = Field(None, gt=0)
    rotation: float = 0.0
    scaleFactor: _Scale = _Scale()
    sensorOffset: _Offset = _Offset()


class _Devices(_Part):
    lens: _Lens = _Lens()
    shutter: _Shutter = _Shutter()
    sensor: _Sensor = _Sensor()
    mla: _Mla = _Mla()


class _Frame(_Part):
    image: _Image
    devices: _Devices = _Devices()


class _Tags(_Part):
    modulationFrame: bool | None = None
    darkFrame: bool | None = None


class _Camera(_Part):
    serialNumber: str = Field('', max_length=100, pattern=r'^[ -~]*$')  # a terminal shows it


class _Private(_Part):
    camera: _Camera = _Camera()


class CameraMetadata(BaseModel):
    """Fields of the camera's JSON that decoding needs (lytro_f01.md, B3); `text` is all of it."""

    model_config = ConfigDict(frozen=True)

    text: str
    image: _Image
    devices: _Devices = _Devices()
    tags: _Tags = _Tags()
    serial: str = ''

    @classmethod
    def parse(cls, text: str) -> 'CameraMetadata':
        """Read the camera's JSON: the whole .TXT (master.picture...), or a frame's part alone.

        Raises CameraError naming the missing or impossible field.
        """
        try:
            data = json.loads(text)
            public, private = _frame_of(data)
            frame = _Frame.model_validate(public)
            return cls(text=text, image=frame.image, devices=frame.devices,
                       tags=_Tags.model_validate(_tags_of(data)),
                       serial=_Private.model_validate(private).camera.serialNumber)
        except ValidationError as error:
            raise CameraError(f'metadata: {explain(error)}') from None
        except (ValueError, RecursionError) as error:
            raise CameraError(f'metadata is not JSON ({error}); is this the .TXT that belongs to '
                              'the .RAW?') from None

    @property
    def zoom(self) -> float | None:
        """Step of the zoom motor; None: unknown."""
        return self.devices.lens.zoomStep

    @property
    def focus(self) -> float | None:
        """Step of the focus motor; None: unknown."""
        return self.devices.lens.focusStep

    @property
    def exposure(self) -> float | None:
        """Exposure time [s]; None: unknown."""
        shutter = self.devices.shutter
        whole = shutter.frameExposureDuration
        return shutter.pixelExposureDuration if whole is None else whole

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


def _tags_of(data: Any) -> Any:
    """Lytro's own marks of the picture (lytro_f01.md, B1), where there are any."""
    for step in ('master', 'picture', 'parameters', 'vendorContent', 'com.lytro.tags'):
        data = data.get(step) if isinstance(data, dict) else None
    return data if isinstance(data, dict) else {}


def _frame_of(data: Any) -> tuple[Any, Any]:
    """The metadata and the private metadata of the picture's frame."""
    if not isinstance(data, dict) or 'master' not in data:
        return data, {}  # validation refuses anything but an object
    frame = data
    for step in ('master', 'picture', 'frameArray', 0, 'frame'):
        try:
            frame = frame[step]
        except (KeyError, IndexError, TypeError):
            raise CameraError(f'metadata has no {step!r} on the way to the frame, master.picture.'
                              'frameArray[0].frame; is this the .TXT of a camera?') from None
    if not isinstance(frame, dict) or 'metadata' not in frame:
        raise CameraError("metadata has no 'metadata' in its frame; is this the .TXT of a camera?")
    private = frame.get('privateMetadata')
    return frame['metadata'], {} if private is None else private
