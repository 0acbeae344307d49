"""RawFrame -> LightField: rectified views of one raw frame (lytro_f01.md, section C)."""

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.calibration.lytro.calibration import RAW_PITCH, Calibration
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.lightfield.lenslets import DARKEST, Lenslets, sum_lenslets
from pmcl_ros.lightfield.light_field import LightField, ViewGrid
from pmcl_ros.lightfield.pupil import Pupil
from pmcl_ros.lightfield.readers.pictures import MOST_BYTES
from pmcl_ros.lightfield.resample import StandIns, ViewPixels, resample_views
from pmcl_ros.lightfield.white_image import relative_light
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.runtime.settings import Settings

VIEWS = 9  # per row and column: one raw pixel apart under a lenslet of ten

_MOST_VIEWS = 21  # two on each raw pixel under a lenslet of ten
_LEAST_SIDE = 8  # px, of a view, as in a calibration
_LIGHT = 2 ** 14  # counts of relative light 1 where light is summed like a picture


class DecodeSettings(Settings):
    """RawFrame -> LightField."""

    calibration: str = Field('', json_schema_extra={'live': True},
                             description='path of the calibration of the camera, YAML, or the '
                             'name that pmcl calibrate --camera gave it')
    white: str = Field('', json_schema_extra={'live': True},
                       description='path of the white image of the camera, RAW or RAW.xz with its '
                       'TXT beside it, or of a folder of white images: the one that fits each '
                       'picture is chosen')
    views: int = Field(VIEWS, ge=1, le=_MOST_VIEWS, description='views of a row and column of the '
                       'grid, odd, one raw pixel apart')
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


@dataclass(frozen=True)
class DecodePlan:
    """Everything of a decode that does not depend on the picture.

    grid: geometry and weights of the views. inside: (n, 2) row and column of the views with light.
    lenslets: all lenslets that they sample. factors: (rows, n, 3, columns) float32, 1 / the light
    of each sample. pixels, shifts, stand_ins: map a view's pixels to the samples.
    """

    grid: ViewGrid
    inside: NDArray[np.int64]
    lattice: Lattice
    lenslets: Lenslets
    factors: NDArray[np.float32]
    pixels: ViewPixels
    shifts: NDArray[np.float64]
    stand_ins: StandIns

    @classmethod
    def make(cls, calibration: Calibration, light: NDArray[np.float32], views: int,
             size: tuple[int, int] | None) -> 'DecodePlan':
        """For `views` x `views` views of `size` (width and height, None: the calibration's).

        light: (height, width), 1 at the centres of lenslets. Raises LightFieldError when the
        lattice does not fit the light, or when the number or the size of views is impossible or
        too large.
        """
        if views % 2 == 0 or not 1 <= views <= _MOST_VIEWS:
            raise LightFieldError(f'{views} views of a row: their number must be odd, from 1 to '
                                  f'{_MOST_VIEWS}')
        lattice = calibration.lattice
        pinhole = calibration.pinhole if size is None else calibration.pinhole.resized(*size)
        needed = views ** 2 * pinhole.width * pinhole.height * 3 * 4
        if min(pinhole.width, pinhole.height) < _LEAST_SIDE or needed > MOST_BYTES:
            raise LightFieldError(
                f'{views}x{views} views of {pinhole.width}x{pinhole.height} px take '
                f'{needed / 2 ** 20:.0f} MiB; their sides must be {_LEAST_SIDE} px or more, and '
                f'all together take {MOST_BYTES // 2 ** 20} MiB at most: choose another size, '
                'or fewer views')
        height, width = light.shape
        last = np.array([width - 1, height - 1])
        pupil = Pupil.measure(light, Lenslets.covering(lattice, 0, last[0], 0, last[1]), views)
        # Rounded as in messages (single precision, -P[3] over fx): every transport keeps the bits.
        positions = pupil.positions.astype(np.float32).astype(np.float64)
        baseline = pinhole.fx * calibration.baseline / pinhole.fx
        inside = np.argwhere(pupil.weights > 0)
        # The shift of a view follows its true position, which may differ from the nominal one.
        focus = baseline / calibration.focus_distance
        shifts = positions[pupil.weights > 0] * [pinhole.fx * focus, pinhole.fy * focus]
        pitch = (RAW_PITCH * calibration.width / pinhole.width,
                 RAW_PITCH * calibration.height / pinhole.height)
        pixels = ViewPixels(pinhole, pitch, calibration.k1, calibration.k2)
        reach = pixels.reach(shifts)
        left, top = np.minimum(reach[:, [0, 2]].min(axis=0), 0)
        right, bottom = np.maximum(reach[:, [1, 3]].max(axis=0), last)
        lenslets = Lenslets.covering(lattice, left, right, top, bottom)
        stand_ins = StandIns.find(lenslets, lattice, inside[:, ::-1] - views // 2, reach, width,
                                  height)
        grid = ViewGrid(pinhole, baseline, positions, pupil.weights)
        plan = cls(grid, inside, lattice, lenslets,
                   _factors(light, lenslets, inside, views // 2), pixels, shifts, stand_ins)
        plan.factors.flags.writeable = False
        return plan

    def sample(self, frame: RawFrame, samples: NDArray[np.float32]) -> None:
        """Fill `samples`, of the shape of `factors`, with the linear colours of a frame."""
        metadata = frame.metadata
        sum_lenslets(frame.counts, metadata.black, self.lenslets, self.inside,
                     self.grid.shape[0] // 2, self.factors,
                     1 / (metadata.white - metadata.black), samples)

    def resample(self, samples: NDArray[np.float32], views: NDArray[np.float32]) -> None:
        """Fill `views` (rows, columns, height, width, 3) from `samples`."""
        rows, columns = self.grid.shape
        slots = self.inside[:, 0] * columns + self.inside[:, 1]
        resample_views(samples, self.lattice, self.lenslets.origin, self.pixels, self.shifts,
                       self.stand_ins, slots,
                       views.reshape(rows * columns, *views.shape[2:]))


def _factors(light: NDArray[np.float32], lenslets: Lenslets, inside: NDArray[np.int64],
             half: int) -> NDArray[np.float32]:
    rows, columns = lenslets.shape
    sums = np.empty((rows, len(inside), 3, columns), np.float32)
    counts = np.rint(np.clip(light, 0, 3) * _LIGHT).astype(np.uint16)
    sum_lenslets(counts, 0, lenslets, inside, half, np.ones_like(sums), 1 / _LIGHT, sums)
    return np.divide(1, np.maximum(sums, np.float32(DARKEST), out=sums), out=sums)


class Decoder:
    """Decodes the raw frames of one camera body at one zoom and focus.

    calibration: geometry and lattice. white: a white image of the same body, zoom and focus; or
    instead of it a map of the light, (height, width) float32, 1 at the centres of lenslets.
    views: of a row and column of the grid, odd, one raw pixel apart. size: width and height of a
    view [px]; None: the calibration's.
    `plan` is the precomputed part, `light` the (height, width) map of the light at each raw pixel.
    Raises LightFieldError when calibration and white image do not fit each other.
    """

    def __init__(self, calibration: Calibration, white: RawFrame | NDArray[np.float32],
                 views: int = VIEWS, size: tuple[int, int] | None = None) -> None:
        self.calibration = calibration
        shape = white.counts.shape if isinstance(white, RawFrame) else white.shape
        if tuple(side // RAW_PITCH for side in shape) != (calibration.height, calibration.width):
            raise LightFieldError(
                f'calibration is for views of {calibration.width}x{calibration.height}, of '
                f'{RAW_PITCH}x{RAW_PITCH} raw pixels each; the white image or the light has '
                f'{"x".join(str(side) for side in shape[::-1])} raw pixels: use those of one '
                'camera')
        if isinstance(white, RawFrame):
            self._check_serial(white.metadata.serial, 'the white image')
            white = relative_light(white)
        self.light = white
        self.plan = DecodePlan.make(calibration, white, views, size)
        self._samples = np.empty(self.plan.factors.shape, np.float32)
        self._busy = threading.Lock()  # guards the samples, which every picture overwrites

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
        # numpy allocates a fresh array of this size in large pages, which is cheap.
        views = np.empty((*self.grid.shape, pinhole.height, pinhole.width, 3), np.float32)
        with self._busy:
            self.plan.sample(frame, self._samples)
            self.plan.resample(self._samples, views)
        return LightField(frame.header, views, self.grid, metadata.image.color.gamma,
                          Colour.from_metadata(metadata))

    def _check_serial(self, serial: str, what: str) -> None:
        expected = self.calibration.serial
        if serial and expected and serial != expected:
            raise LightFieldError(
                f'{what} is from camera {serial}, the calibration is for {expected}; use the '
                'calibration and the white image of one camera')
