"""The file that `camera_calibration` of ROS writes, a CameraInfo in YAML: keys of views.yaml."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field, ValidationError, field_validator, model_validator

from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.runtime.settings import Settings, explain


class Matrix(Settings):
    """A matrix of such a file."""

    rows: int = Field(ge=0, description='number of rows')
    cols: int = Field(ge=0, description='number of columns')
    data: tuple[float, ...] = Field(description='its numbers, row by row')

    @model_validator(mode='after')
    def _whole(self) -> 'Matrix':
        if len(self.data) != self.rows * self.cols:
            raise ValueError(f'rows and cols are {self.rows} and {self.cols}, which is '
                             f'{self.rows * self.cols} numbers, but data has {len(self.data)}')
        return self


class CameraInfoFile(Settings):
    """The file; of raw pictures, whose camera matrix and distortion count."""

    image_width: int = Field(ge=1, le=100_000, description='of raw pictures [px]')
    image_height: int = Field(ge=1, le=100_000, description='of raw pictures [px]')
    camera_name: Any = Field('', description='not used')
    camera_matrix: Matrix = Field(description='3x3: fx, 0, cx, 0, fy, cy, 0, 0, 1 [px]')
    distortion_model: str = Field('plumb_bob', description='of REP-104')
    distortion_coefficients: Matrix = Field(description="of the model, in OpenCV's order")
    rectification_matrix: Any = Field(None, description='of rectified pictures, not used')
    projection_matrix: Any = Field(None, description='of rectified pictures, not used')

    @field_validator('camera_matrix')
    @classmethod
    def _of_pinhole(cls, value: Matrix) -> Matrix:
        if (value.rows, value.cols) != (3, 3) or not np.array_equal(
                np.array(value.data)[[1, 3, 6, 7, 8]], [0, 0, 0, 0, 1]):
            raise ValueError(f'{value.rows}x{value.cols} numbers {list(value.data)}, expected '
                             '3x3: fx, 0, cx, 0, fy, cy, 0, 0, 1')
        return value

    @property
    def lens(self) -> Lens:
        """Raises LightFieldError for an unknown model, or impossible numbers."""
        return Lens.from_matrix(
            self.image_width, self.image_height, np.reshape(self.camera_matrix.data, (3, 3)),
            self.distortion_coefficients.data, self.distortion_model)


def is_camera_info(values: object) -> bool:
    """Whether the values of a YAML file are of a CameraInfo."""
    return isinstance(values, Mapping) and ('camera_matrix' in values or 'image_width' in values)


def camera_entry(values: Mapping[str, Any]) -> dict[str, Any]:
    """A camera of views.yaml of the values of a CameraInfo; keys of views.yaml beside them stay.

    Raises ValueError saying what is wrong.
    """
    others = {key: each for key, each in values.items() if key not in CameraInfoFile.model_fields}
    try:
        lens = CameraInfoFile.model_validate(
            {key: each for key, each in values.items() if key not in others}).lens
    except ValidationError as error:
        raise ValueError(explain(error, CameraInfoFile)) from None
    except LightFieldError as error:
        raise ValueError(str(error)) from None
    pinhole = lens.pinhole
    entry = {'width': pinhole.width, 'height': pinhole.height, 'fx': pinhole.fx, 'fy': pinhole.fy,
             'cx': pinhole.cx, 'cy': pinhole.cy, 'model': lens.model,
             'distortion': lens.distortion}
    if twice := [key for key in entry if key in others]:
        raise ValueError(f'{", ".join(twice)}: leave it out, camera_matrix and its like tell it')
    return entry | others
