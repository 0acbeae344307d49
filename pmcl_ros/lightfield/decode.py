"""RawFrame -> LightField: 9x9 rectified views of one raw frame (lytro_f01.md, section C)."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.errors import LightFieldError
from pmcl_ros.lightfield.calibration import Calibration
from pmcl_ros.lightfield.devignette import devignette, relative_light
from pmcl_ros.lightfield.geometry import ViewGrid, nominal_positions
from pmcl_ros.lightfield.lenslets import sample_lenslets
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.resample import resample_views

_VIEWS = 9  # per row and column: one raw pixel apart under a lenslet of ten
_PITCH = 10  # raw pixels per view pixel
# Raw px: so far within its lenslet's edge must a view be read. On the edge half the light is the
# neighbour's; bodies whose pitch is 10.004 px have the 3-4-5 views there, inside by a hair.
_WITHIN = 0.25
_BRIGHTEST = 1.1  # times the centre's light: no view gets as much, if the lattice is the camera's


class Decoder:
    """Decodes the raw frames of one camera body at one zoom and focus.

    calibration: geometry and lattice. white: a white image of the same body, zoom and focus.
    Raises LightFieldError when the two do not fit each other.
    """

    def __init__(self, calibration: Calibration, white: RawFrame) -> None:
        height, width = white.counts.shape
        if (calibration.width * _PITCH, calibration.height * _PITCH) != (width, height):
            raise LightFieldError(
                f'calibration is for views of {calibration.width}x{calibration.height}, that is '
                f'raw frames of {calibration.width * _PITCH}x{calibration.height * _PITCH}; the '
                f'white image has {width}x{height}')
        self.calibration = calibration
        self._check_serial(white, 'the white image')
        self._light = relative_light(white)
        lattice = calibration.lattice
        self._radius = lattice.pitch_px / 2
        i0, i1, j0, j1 = lattice.index_range(width, height)
        self._origin = (j0, i0)
        self._centres = lattice.centres(*np.meshgrid(np.arange(i0, i1), np.arange(j0, j1)))
        positions = nominal_positions(_VIEWS, _VIEWS)
        weights = self._weights(positions)
        self._inside = weights > 0
        self._offsets = positions[self._inside]
        focus = calibration.baseline / calibration.focus_distance
        self._shifts = self._offsets * [calibration.fx * focus, calibration.fy * focus]
        self._grid = ViewGrid(calibration.pinhole, calibration.baseline, positions, weights)

    @property
    def grid(self) -> ViewGrid:
        """The geometry and the weights of the views."""
        return self._grid

    def decode(self, frame: RawFrame) -> LightField:
        """The views of one raw frame; LightFieldError when it is of another size or camera."""
        self._check_serial(frame, 'the picture')
        linear = devignette(frame, self._light)
        samples = sample_lenslets(linear, self._centres, self._offsets, self._radius)
        pinhole = self._grid.pinhole
        views = np.zeros((_VIEWS, _VIEWS, pinhole.height, pinhole.width, 3), np.float32)
        views[self._inside] = resample_views(samples, self.calibration.lattice, self._origin,
                                             pinhole.width, pinhole.height, self._shifts)
        return LightField(frame.header, views, self._grid, frame.metadata.image.color.gamma)

    def _check_serial(self, frame: RawFrame, what: str) -> None:
        serial, expected = frame.metadata.serial, self.calibration.serial
        if serial and expected and serial != expected:
            raise LightFieldError(
                f'{what} is from camera {serial}, the calibration is for {expected}; use the '
                'calibration and the white image of one camera')

    def _weights(self, positions: NDArray[np.float64]) -> NDArray[np.float32]:
        """(9, 9) the light of each view relative to the centre view's; 0 outside the pupil.

        Beyond its disc a lenslet's neighbour begins: such a view would show the neighbour's light.
        """
        inside = np.hypot(*np.moveaxis(positions, -1, 0)) < self._radius - _WITHIN
        light = sample_lenslets(self._light, self._centres, positions[inside], self._radius)
        weights = np.zeros(inside.shape, np.float32)
        weights[inside] = np.nanmean(light, axis=(1, 2, 3))
        centre = weights[_VIEWS // 2, _VIEWS // 2]
        if not weights.max() < _BRIGHTEST * centre:
            raise LightFieldError(
                f'the white image is {centre:.2f} bright under the centres of the lenslets, up to '
                f'{weights.max():.2f} beside them; the lattice of the calibration belongs to '
                'another camera, zoom or focus')
        return np.maximum(weights / centre, 0)
