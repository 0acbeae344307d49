"""The optics of a first-generation Lytro: which rays of the scene each raw pixel receives."""

import json
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pmcl_ros.camera.raw_frame import TILE, UPPER_LEFT
from pmcl_ros.lightfield.calibration.lytro.calibration import RAW_PITCH, Calibration
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.decode import VIEWS
from pmcl_ros.lightfield.light_field import ViewGrid
from pmcl_ros.runtime.kernels import compiled, rounds
from pmcl_ros.runtime.settings import Settings
from pmcl_ros.simulation.scenes.sensor import Sensor, pupil_views

F01, F01_RAW = 'f01', 'f01-raw'  # as options name it: by its views; by its raw pictures
_ZOOM, _FOCUS = 600, 700  # steps of the motors: reported, not modelled
_ISO = 80  # reported, not modelled
_EXPOSURE = 0.01  # s: reported, not modelled
# Both measured in decoded pictures, of textured and of even walls.
_BLUR = 0.45  # px of a view: what lenslets and their interpolation blur beyond its pixels
_AVERAGED = 0.118  # variance of a view's green over that of a raw pixel: decoders average pixels
# Fractional parts of k times these fill the four-dimensional cube evenly (Roberts, The
# unreasonable effectiveness of quasirandom sequences, 2018).
_STEPS = 1.1673039782614187 ** -np.arange(1, 5)


class LytroCamera(Settings):
    """An aperture before a thin main lens, a hexagonal lattice of round thin lenslets, a sensor.

    The optical frame's origin is the middle of the aperture. The lenslets focus the aperture on
    the sensor, so that a point of a pixel receives one point of it. Raw pictures are upright:
    their +x is the optical frame's. Vignetting is the aperture's edge and the fourth power of the
    cosine under which light from the main lens meets a lenslet; there is no diffraction, no
    aberration, no light between lenslets.
    Numbers are those of an F01 (lytro_f01.md, B3) at twice its widest zoom, its exit pupil
    as far away.
    """

    width: int = Field(3280, ge=80, le=8192, description='of the sensor [raw px]')
    height: int = Field(3280, ge=80, le=8192, description='of the sensor [raw px]')
    pixel: float = Field(1.4e-6, gt=0, description='pitch of the pixels [m]')
    focal: float = Field(0.0129, gt=0, description='focal length of the main lens [m]')
    stop: float = Field(0.01194, ge=0, description='from the aperture to the main lens behind it '
                        '[m]: near the focal length light falls upright on the sensor')
    f_number: float = Field(2.0, gt=0, description='focal length over the width of the aperture')
    focus: float = Field(0.5, gt=0, description='from the aperture to the plane that is sharp on '
                         'the lenslets [m]')
    gap: float = Field(2.5e-5, gt=0, description='from the lenslets to the sensor [m]')
    lens_pitch: float = Field(1.3898614883e-5, gt=0, description='of the lenslets of a row [m]')
    row_scale: float = Field(1.000188, gt=0, description='of the step between rows, to that of a '
                             'regular lattice')
    rotation: float = Field(-0.0049, description='of the rows, from +x towards +y [rad]')
    lens: tuple[float, float] = Field((2.02e-6, 2.55e-6), description='a lenslet, from the middle '
                                      'of the sensor [m]')
    axis: tuple[float, float] = Field((2.1e-5, -1.3e-5), description='axis of the main lens, from '
                                      'the middle of the sensor [m]')
    electrons: float = Field(3000, gt=0, description='of a pixel at white')
    read: float = Field(5, ge=0, description='standard deviation in the dark [electrons]')
    black: int = Field(168, ge=0, le=4095, description='count without light')
    white: int = Field(4095, ge=0, le=4095, description='count at white')
    gains: tuple[float, float, float] = Field((1.1484, 1.0, 1.1484), description='white balance '
                                              'of red, green, blue')
    matrix: tuple[float, float, float, float, float, float, float, float, float] = Field(
        (3.1116, -1.9394, -0.1722, -0.3629, 1.6409, -0.2780, 0.0790, -1.1558, 2.0768),
        description='from the balanced colours of the sensor to linear sRGB, row by row')
    serial: str = Field('A000000020', description='serial number')

    @model_validator(mode='after')
    def _possible(self) -> 'LytroCamera':
        if self.focus <= self.focal:
            raise ValueError(f'focus {self.focus:g} m is within the focal length')
        if self.stop >= self.focal:
            raise ValueError(f'stop {self.stop:g} m is not within the focal length')
        if self.pupil > self.lattice.pitch_px / 2:
            raise ValueError(f'at f/{self.f_number:g} the images of the aperture under the '
                             f'lenslets overlap: their radius is {self.pupil:.2f} px, half the '
                             f'pitch {self.lattice.pitch_px / 2:.2f} px')
        return self

    @property
    def image(self) -> float:
        """Distance on the lenslets over the slope of the ray that comes in [m]."""
        return self.focal * self.focus / (self.focus + self.stop - self.focal)

    @property
    def exit_pupil(self) -> float:
        """From the image of the aperture by the main lens to the lenslets [m]."""
        behind = 1 / (1 / self.focal - 1 / (self.focus + self.stop))
        return behind + self.stop * self.focal / (self.focal - self.stop)

    @property
    def baseline(self) -> float:
        """On the aperture, between what two neighbouring raw pixels see [m]."""
        return self.pixel * self.image / self.gap

    @property
    def pupil(self) -> float:
        """Radius of the aperture [view steps], of its images under the lenslets [raw px]."""
        return self.focal / self.f_number / 2 / self.baseline

    @property
    def axis_px(self) -> tuple[float, float]:
        """Where the main lens' axis meets the sensor [raw px]."""
        return ((self.width - 1) / 2 + self.axis[0] / self.pixel,
                (self.height - 1) / 2 + self.axis[1] / self.pixel)

    @property
    def lattice(self) -> Lattice:
        """The micro-images' centres: the lenslets, projected from the exit pupil's centre."""
        spread = 1 + self.gap / self.exit_pupil
        x, y = (at + spread * (lens - axis) / self.pixel for at, lens, axis in zip(
            self.axis_px, self.lens, self.axis, strict=True))
        pitch = spread * self.lens_pitch / self.pixel
        return Lattice(pitch_px=pitch, row_step_px=pitch * self.row_scale * 3 ** 0.5 / 2,
                       rotation=self.rotation, centre_px=(x, y))

    @property
    def calibration(self) -> Calibration:
        """What a perfect calibration of the camera finds."""
        focal = self.image * (1 + self.gap / self.exit_pupil) / self.pixel / RAW_PITCH
        cx, cy = ((each + 0.5) / RAW_PITCH - 0.5 for each in self.axis_px)
        return Calibration(
            width=self.width // RAW_PITCH, height=self.height // RAW_PITCH, fx=focal, fy=focal,
            cx=cx, cy=cy, baseline=self.baseline, focus_distance=self.focus, lattice=self.lattice,
            serial=self.serial, zoom=_ZOOM, focus=_FOCUS)

    @property
    def field(self) -> float:
        """The smaller side of a view over its focal length."""
        calibration = self.calibration
        return min(calibration.width, calibration.height) / calibration.fx

    @property
    def response(self) -> NDArray[np.float64]:
        """(3, 3) from linear sRGB to the sensor's red, green, blue."""
        colours = np.linalg.inv(np.reshape(self.matrix, (3, 3)))
        return np.asarray(colours / np.array(self.gains)[:, None])

    def sensor(self, rng: np.random.Generator) -> Sensor:
        """The views that a decoder makes, for rendering them directly; the exposure is random."""
        calibration = self.calibration
        grid = ViewGrid(calibration.pinhole, self.baseline, *pupil_views(VIEWS, self.pupil))
        return Sensor(grid, self.focus, self.pupil, _BLUR, float(rng.uniform(0.2, 0.42)),
                      _AVERAGED / self.electrons, _AVERAGED ** 0.5 * self.read / self.electrons,
                      (1.0, 1.0, 1.0))

    def rays(self, pixels: NDArray[np.integer], samples: int, rng: np.random.Generator
             ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float32]]:
        """Origins (n, samples, 3) in the aperture, unit directions (n, samples, 3), weights.

        pixels: (n, 2) column and row. Each ray belongs to a random point of its pixel and of the
        lenslet before it; the optical frame [m]. weights: (n, samples) float32, light relative to
        that on the axis; 0: the aperture stops the ray.

        The lenslet images the pixel's point onto a point of the aperture. From there rays go to
        the point at the focus depth that the main lens images onto the lenslet's point.
        """
        lattice = self.lattice
        shape = len(pixels), samples
        origins, directions = np.empty((*shape, 3)), np.empty((*shape, 3))
        weights = np.empty(shape, np.float32)
        numbers = np.array([
            lattice.pitch_px, lattice.row_step_px, math.cos(lattice.rotation),
            math.sin(lattice.rotation), *lattice.centre_px, *self.axis_px, self.pixel, self.image,
            self.exit_pupil, self.gap, self.focus, self.lens_pitch / 2,
            self.focal / self.f_number / 2])
        _rays(np.ascontiguousarray(pixels, np.int64), rng.random((len(pixels), 4)), _STEPS,
              numbers, origins, directions, weights)
        return origins, directions, weights

    def text(self, is_white: bool = False) -> str:
        """The JSON beside a raw picture; is_white: it is a white image."""
        black, white = (dict.fromkeys(('r', 'gr', 'gb', 'b'), level)
                        for level in (self.black, self.white))
        red, green, blue = self.gains
        metadata: dict[str, Any] = {
            'type': 'lightField',
            'image': {
                'width': self.width, 'height': self.height, 'orientation': 1,
                'representation': 'rawPacked',
                'rawDetails': {'pixelFormat': {'rightShift': 0, 'black': black, 'white': white},
                               'pixelPacking': {'endianness': 'big', 'bitsPerPixel': 12},
                               'mosaic': {'tile': TILE, 'upperLeftPixel': UPPER_LEFT}},
                'color': {'ccmRgbToSrgbArray': self.matrix, 'gamma': 0.41666,
                          'whiteBalanceGain': {'r': red, 'gr': green, 'gb': green, 'b': blue}}},
            'devices': {
                'sensor': {'bitsPerPixel': 12, 'pixelPitch': self.pixel, 'iso': _ISO},
                'lens': {'focalLength': self.focal, 'fNumber': self.f_number, 'zoomStep': _ZOOM,
                         'focusStep': _FOCUS, 'exitPupilOffset': {'z': self.exit_pupil}},
                'mla': {'tiling': 'hexUniformRowMajor', 'lensPitch': self.lens_pitch,
                        'rotation': self.rotation,
                        'scaleFactor': {'x': 1.0, 'y': self.row_scale},
                        'sensorOffset': {'x': self.lens[0], 'y': self.lens[1], 'z': self.gap}},
                'shutter': {'mechanism': 'sensorOpenApertureClose',
                            'frameExposureDuration': _EXPOSURE}},
            'camera': {'make': 'Lytro, Inc.', 'model': 'F01', 'firmware': 'simulated'}}
        frame = {'metadata': metadata,
                 'privateMetadata': {'camera': {'serialNumber': self.serial}}}
        picture = {'frameArray': [{'frame': frame}], 'parameters': {'vendorContent': {
            'com.lytro.tags': {'modulationFrame': is_white, 'darkFrame': False}}}}
        return json.dumps({'master': {'picture': picture}}, indent=1) + '\n'


@compiled(parallel=True, exact=True)
def _rays(pixels, starts, steps, numbers, origins,  # type: ignore[no-untyped-def]
          directions, weights, portion):
    (pitch, row_step, cos, sin, cx, cy, ax, ay, size, image, pupil, gap, focus, radius,
     aperture) = numbers
    spread = pupil / (pupil + gap)  # from the sensor to the lenslets
    for n in rounds(len(pixels), portion):
        for k in range(weights.shape[1]):
            x = pixels[n, 0] - 0.5 + (starts[n, 0] + k * steps[0]) % 1
            y = pixels[n, 1] - 0.5 + (starts[n, 1] + k * steps[1]) % 1
            # The lenslet: of each of the two rows about the point the nearest, then the nearer.
            along = (cos * (x - cx) + sin * (y - cy)) / pitch
            across = (cos * (y - cy) - sin * (x - cx)) / row_step
            best, u, v = np.inf, 0.0, 0.0
            for row in (np.floor(across), np.floor(across) + 1):
                half = (row % 2) / 2
                column = np.rint(along - half) + half
                apart = ((along - column) * pitch) ** 2 + ((across - row) * row_step) ** 2
                if apart < best:
                    best, u, v = apart, column * pitch, row * row_step
            mx, my = cx + cos * u - sin * v, cy + sin * u + cos * v
            # A point of it, from the axis, in the plane of the lenslets [m].
            reach = radius * np.sqrt((starts[n, 2] + k * steps[2]) % 1)
            turn = 2 * np.pi * ((starts[n, 3] + k * steps[3]) % 1)
            lx = (mx - ax) * size * spread + reach * np.cos(turn)
            ly = (my - ay) * size * spread + reach * np.sin(turn)
            # The sensor's x and y are those of the scene, upside down behind the lens.
            px, py = (x - mx) * size * image / gap, (y - my) * size * image / gap
            dx, dy = lx * focus / image - px, ly * focus / image - py
            length = np.sqrt(dx * dx + dy * dy + focus * focus)
            origins[n, k, 0], origins[n, k, 1], origins[n, k, 2] = px, py, 0.0
            directions[n, k, 0], directions[n, k, 1] = dx / length, dy / length
            directions[n, k, 2] = focus / length
            tx, ty = (x - mx) * size / gap + lx / pupil, (y - my) * size / gap + ly / pupil
            inside = px * px + py * py <= aperture * aperture
            weights[n, k] = (1 + tx * tx + ty * ty) ** -2 if inside else 0.0
