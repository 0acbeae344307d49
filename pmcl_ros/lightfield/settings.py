"""Parameters of the decode."""

from pydantic import Field, model_validator

from pmcl_ros.runtime.settings import Settings


class DecodeSettings(Settings):
    """RawFrame -> LightField."""

    calibration: str = Field('', json_schema_extra={'live': True},
                             description='path of the calibration of the camera, YAML')
    white: str = Field('', json_schema_extra={'live': True},
                       description='path of the white image of the camera, RAW or RAW.xz with its '
                       'TXT beside it, or of a folder of such: the one that fits each picture is '
                       'chosen')
    views: int = Field(9, ge=1, le=21, description='views of a row and column of the grid, odd, '
                       'one raw pixel apart')
    width: int = Field(0, ge=0, le=2000, description='width of a view [px]; 0: that of the '
                       'calibration')
    height: int = Field(0, ge=0, le=2000, description='height of a view [px]; 0: that of the '
                        'calibration')

    @model_validator(mode='after')
    def _possible(self) -> 'DecodeSettings':
        if self.views % 2 == 0:
            raise ValueError(f'{self.views} views of a row have no centre view; views must be odd')
        if (self.width == 0) != (self.height == 0):
            raise ValueError(f'views of {self.width}x{self.height} px: give width and height, or '
                             '0 for both')
        return self

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of a view [px]; None: those of the calibration."""
        return (self.width, self.height) if self.width else None
