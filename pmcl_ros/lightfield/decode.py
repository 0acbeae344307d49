"""RawFrame -> LightField: 9x9 rectified views of one raw frame (lytro_f01.md, section C)."""

import threading

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.calibration.calibration import Calibration
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.lightfield.devignette import relative_light
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.plan import DecodePlan
from pmcl_ros.lightfield.view_grid import ViewGrid
from pmcl_ros.runtime.errors import LightFieldError

VIEWS = 9  # per row and column: one raw pixel apart under a lenslet of ten
_PITCH = 10  # raw pixels per pixel of the calibration


class Decoder:
    """Decodes the raw frames of one camera body at one zoom and focus.

    calibration: geometry and lattice. white: a white image of the same body, zoom and focus.
    views: of a row and column of the grid, odd, one raw pixel apart. size: width and height of a
    view [px] other than the calibration's.
    Keeps the plan of the decode; `light` is the (height, width) map of the light that each raw
    pixel got. Raises LightFieldError when calibration and white image do not fit each other.
    """

    def __init__(self, calibration: Calibration, white: RawFrame, views: int = VIEWS,
                 size: tuple[int, int] | None = None) -> None:
        self._begin(calibration, white.counts.shape, white.metadata.serial, 'the white image')
        self._prepare(relative_light(white), views, size)

    @classmethod
    def of_light(cls, calibration: Calibration, light: NDArray[np.float32], serial: str = '',
                 views: int = VIEWS, size: tuple[int, int] | None = None) -> 'Decoder':
        """A decoder where there is no white image.

        light: (height, width) float32, the light each pixel got, 1 at the centres of lenslets.
        serial: of the camera that it belongs to; empty: unknown.
        """
        decoder = cls.__new__(cls)
        decoder._begin(calibration, light.shape, serial, 'the map of light')
        decoder._prepare(light, views, size)
        return decoder

    @property
    def grid(self) -> ViewGrid:
        """The geometry and the weights of the views."""
        return self.plan.grid

    def decode(self, frame: RawFrame) -> LightField:
        """The views of one raw frame; LightFieldError when it is of another size or camera."""
        metadata, pinhole = frame.metadata, self.grid.pinhole
        self._check_serial(metadata.serial, 'the picture')
        if frame.counts.shape != self.light.shape:
            raise LightFieldError(f'raw frame {frame.counts.shape} and white image '
                                  f'{self.light.shape} differ in size')
        # A fresh array of this size from numpy has large pages, which cost little to get.
        views = np.empty((*self.grid.shape, pinhole.height, pinhole.width, 3), np.float32)
        with self._busy:
            self.plan.sample(frame, self._samples)
            self.plan.resample(self._samples, views)
        return LightField(frame.header, views, self.grid, metadata.image.color.gamma,
                          Colour.of(metadata))

    def _begin(self, calibration: Calibration, shape: tuple[int, ...], serial: str,
               what: str) -> None:
        self.calibration = calibration
        if shape != (calibration.height * _PITCH, calibration.width * _PITCH):
            raise LightFieldError(
                f'calibration is for views of {calibration.width}x{calibration.height}, that is '
                f'raw frames of {calibration.width * _PITCH}x{calibration.height * _PITCH}; '
                f'{what} has {"x".join(str(side) for side in shape[::-1])}')
        self._check_serial(serial, what)

    def _prepare(self, light: NDArray[np.float32], views: int,
                 size: tuple[int, int] | None) -> None:
        self.light = light
        self.plan = DecodePlan.make(self.calibration, light, views, size)
        self._samples = np.empty(self.plan.factors.shape, np.float32)
        self._busy = threading.Lock()  # of the samples, which every picture overwrites

    def _check_serial(self, serial: str, what: str) -> None:
        expected = self.calibration.serial
        if serial and expected and serial != expected:
            raise LightFieldError(
                f'{what} is from camera {serial}, the calibration is for {expected}; use the '
                'calibration and the white image of one camera')
