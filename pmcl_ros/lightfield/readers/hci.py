"""The 4D Light Field Benchmark's folders (Honauer et al., ACCV 2016; lightfield-analysis.net).

parameters.cfg has the geometry; input_Cam000.png, ... are the views, row by row from the upper
left. Cameras and sensors are shifted, not turned: points at focus_distance_m have no disparity. A
focus_distance_m of 0 means unshifted sensors.
"""

import configparser
import math
from pathlib import Path

from pydantic import ConfigDict, Field, ValidationError

from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField, nominal_positions
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.lightfield.readers.view_files import ViewFiles
from pmcl_ros.runtime.errors import FileError, LightFieldError, told_as
from pmcl_ros.runtime.settings import Settings, explain
from pmcl_ros.runtime.text_file import read_text

NAME = 'parameters.cfg'


class _Parameters(Settings):
    """The entries of intrinsics and extrinsics that are used."""

    model_config = ConfigDict(extra='ignore')

    focal_length_mm: float = Field(gt=0, lt=1e5)
    image_resolution_x_px: int = Field(gt=0, lt=1e5)
    image_resolution_y_px: int = Field(gt=0, lt=1e5)
    sensor_size_mm: float = Field(gt=0, lt=1e5)
    num_cams_x: int = Field(ge=1, le=999)
    num_cams_y: int = Field(ge=1, le=999)
    baseline_mm: float = Field(gt=0, lt=1e6)
    focus_distance_m: float = Field(ge=0)


def read_hci(folder: Path, header: Header, reduction: Reduction) -> LightField:
    """The light field of a scene's folder.

    Raises LightFieldError when parameters.cfg or a view is missing or impossible.
    """
    of = _parameters(folder / NAME)
    width, height = of.image_resolution_x_px, of.image_resolution_y_px
    focal = of.focal_length_mm / of.sensor_size_mm * max(width, height)
    rows, columns = of.num_cams_y, of.num_cams_x
    paths = [[folder / f'input_Cam{row * columns + column:03d}.png' for column in range(columns)]
             for row in range(rows)]
    positions = nominal_positions(rows, columns) * of.baseline_mm / 1000
    focus = of.focus_distance_m or math.inf
    # The sensors are shifted towards the axis of the grid, which lies half a step beside the
    # centre view for an even number of views.
    beside = [side % 2 == 0 for side in (columns, rows)]
    cx, cy = ((size - 1) / 2 + even * focal * of.baseline_mm / 2000 / focus
              for size, even in zip((width, height), beside, strict=True))
    files = ViewFiles(paths, positions, focal, focal, cx, cy, focus)
    with told_as(LightFieldError, name=folder):
        light_field = files.read(header, reduction)
    found = light_field.grid.pinhole
    expected = width // reduction.shrink, height // reduction.shrink
    if (found.width, found.height) != expected:
        raise LightFieldError(f'the views in {folder} shrink to {found.width}x{found.height} px, '
                              f'{NAME} says {expected[0]}x{expected[1]}; do they belong together?')
    return light_field


def _parameters(path: Path) -> _Parameters:
    parser = configparser.ConfigParser(delimiters='=', interpolation=None)
    try:
        parser.read_string(read_text(path))
        return _Parameters.model_validate({
            name: value for section in ('intrinsics', 'extrinsics')
            for name, value in parser[section].items()})
    except FileError as error:
        raise LightFieldError(str(error)) from None
    except KeyError as error:
        raise LightFieldError(f'{path} has no section {error}; expected a parameters.cfg of the '
                              '4D Light Field Benchmark') from None
    except ValidationError as error:
        raise LightFieldError(f'{path}: {explain(error)}') from None
    except configparser.Error as error:
        raise LightFieldError(f'{path} is no configuration file: {error}') from None
