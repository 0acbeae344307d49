"""Parameters of the decode."""

from pydantic import Field

from pmcl_ros.settings import Settings


class DecodeSettings(Settings):
    """RawFrame -> LightField."""

    calibration: str = Field('', description='path of the calibration of the camera, YAML')
    white: str = Field('', description='path of the white image of the camera, RAW or RAW.xz with '
                       'its TXT beside it')
