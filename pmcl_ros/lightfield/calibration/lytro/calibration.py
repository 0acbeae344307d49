"""Calibration: the geometry of one camera's views, at one zoom and focus."""

import math
from pathlib import Path

from pydantic import Field

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.runtime.errors import FileError, SettingsError, told_as
from pmcl_ros.runtime.settings import Settings
from pmcl_ros.runtime.text_file import read_json

RAW_PITCH = 10  # raw pixels per view pixel, along rows and columns
_OF_CAMERA = ('width', 'height', 'fx', 'fy', 'cx', 'cy', 'focus_distance')


class Calibration(Settings):
    """A camera's YAML file: the centre view's pinhole, the views' baseline and focus, the lattice.

    Lattice-aligned views have zero disparity at `focus_distance`, rectified ones at infinity.
    """

    width: int = Field(328, ge=8, le=2000, description='width of a view [px]')
    height: int = Field(328, ge=8, le=2000, description='height of a view [px]')
    fx: float = Field(gt=1, lt=1e5, description='focal length of the centre view [px]')
    fy: float = Field(gt=1, lt=1e5, description='focal length of the centre view [px]')
    cx: float = Field(description='principal point of the centre view, column [px]')
    cy: float = Field(description='principal point of the centre view, row [px]')
    baseline: float = Field(gt=0, lt=0.1,
                            description='between adjacent views (one raw pixel apart) [m]')
    focus_distance: float = Field(
        gt=0, allow_inf_nan=True, description='depth of zero disparity of lattice-aligned '
        'views; .inf: the views are left lattice-aligned [m]')
    k1: float = Field(0.0, gt=-10, lt=10,
                      description='radial distortion: x_distorted = x (1 + k1 r^2 + k2 r^4), x '
                      'and r in normalised image coordinates [1]')
    k2: float = Field(0.0, gt=-10, lt=10, description='radial distortion, fourth order [1]')
    lattice: Lattice
    serial: str = Field('', description='serial number of the camera; empty: unknown')
    zoom: float | None = Field(None, description='step of the zoom motor; none: unknown')
    focus: float | None = Field(None, description='step of the focus motor; none: unknown')

    @property
    def pinhole(self) -> Pinhole:
        """The centre view's camera."""
        return Pinhole(self.width, self.height, self.fx, self.fy, self.cx, self.cy)

    @classmethod
    def aligned(cls, lattice: Lattice, width: int = 328, height: int = 328) -> 'Calibration':
        """A calibration for lattice-aligned views, when only the lattice is known.

        Focal length and baseline are typical values of a first-generation Lytro.
        """
        focal = 2.9 * width
        return cls(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2,
                   cy=(height - 1) / 2, baseline=7e-4, focus_distance=math.inf, lattice=lattice)

    @classmethod
    def from_truth(cls, capture: Path | str, white: Path | str,
                   serial: str = '') -> 'Calibration':
        """The calibration of simulated captures from their truth files.

        capture: a capture's truth.json with `camera`. white: the white image's with `lattice`.
        Raises SettingsError when they cannot be read or hold none.
        """
        with told_as(SettingsError, FileError):
            of_capture, of_white = read_json(capture), read_json(white)
        try:
            camera, lattice = of_capture['camera'], of_white['lattice']
            values = {name: camera[name] for name in _OF_CAMERA}
            values['baseline'] = camera['baseline_step']
            values['lattice'] = {name: lattice[name] for name in Lattice.model_fields}
        except (ValueError, KeyError, TypeError) as error:
            raise SettingsError(
                f'{capture} and {white} hold no camera and lattice: {error!r}') from None
        values['serial'] = serial
        return cls.make(values, str(capture))
