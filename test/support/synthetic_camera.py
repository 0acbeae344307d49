"""A small light-field camera whose raw frames of a known light field are computed by pixel."""

import json

import numpy as np
from scipy.spatial import cKDTree

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration

SIDE = 400  # raw px
BLACK, WHITE = 168, 4095


class SyntheticCamera:
    """A camera of 40x40 view px; views one step apart show infinity 0.77 px (x), 0.7 px (y) apart
    when they are lattice-aligned.

    text: the JSON of frames of its size.
    tilt: how much more light a step along +x and +y of the aperture gets.
    pupil: radius of the main lens' pupil under a lenslet [raw px]; None: as the lenslet's disc.
    k1, k2: radial distortion.
    """

    def __init__(self, text, pitch=9.95, serial='A1', tilt=(0, 0), pupil=None, k1=0, k2=0):
        self.calibration = Calibration(
            width=SIDE // 10, height=SIDE // 10, fx=110, fy=100, cx=19.7, cy=19.2,
            baseline=0.0035, focus_distance=0.5, serial=serial, k1=k1, k2=k2,
            lattice={'pitch_px': pitch, 'row_step_px': pitch * 0.8662, 'rotation': 0.004,
                     'centre_px': (201.3, 197.8)})
        self.metadata = CameraMetadata.parse(whole_text(text, serial))
        raw = np.indices((SIDE, SIDE))[::-1].transpose(1, 2, 0).astype(float)  # (x, y)
        i, j = np.meshgrid(np.arange(-30, 30), np.arange(-35, 35))
        centres = self.calibration.lattice.centres(i, j).reshape(-1, 2)
        owner = centres[cKDTree(centres).query(raw)[1]]
        # Of every raw pixel: where its lenslet looks [view px], and from where on the aperture.
        self.place = self._undistorted((owner - 4.5) / 10)
        self.offset = raw - owner
        # Less light towards the rim of each lenslet and the corners of the sensor.
        self.light = ((1 - 0.5 * np.hypot(*self.offset.T).T ** 4 / 5 ** 4)
                      * (1 - 0.1 * ((raw / SIDE - 0.5) ** 2).sum(-1))
                      * (1 + self.offset @ tilt))
        if pupil is not None:  # a pixel on the edge gets its part of the light
            self.light *= np.clip(pupil + 0.5 - np.hypot(*self.offset.T).T, 0, 1)

    def _undistorted(self, place):
        """Where a camera without distortion sees what this one sees at places (..., 2) [px]."""
        calibration = self.calibration
        centre = np.array([calibration.cx, calibration.cy])
        focal = np.array([calibration.fx, calibration.fy])
        distorted = (place - centre) / focal
        found = distorted
        for _ in range(50 if calibration.k1 or calibration.k2 else 0):
            square = (found ** 2).sum(axis=-1, keepdims=True)
            found = distorted / (1 + calibration.k1 * square + calibration.k2 * square ** 2)
        return centre + found * focal

    @property
    def shift(self):
        """(2,) px that lattice-aligned views a step apart show infinity apart."""
        calibration = self.calibration
        focal = np.array([calibration.fx, calibration.fy])
        return focal * calibration.baseline / calibration.focus_distance

    def disparity(self, depth):
        """(2,) px that rectified views a step apart show a plane at `depth` [m] apart."""
        return self.shift * self.calibration.focus_distance / depth

    def white(self, level=(0.6, 0.5, 0.55, 0.4)):
        """The white image; `level` of the phases (blue, green, green, red) where brightest."""
        phases = np.empty((SIDE, SIDE))
        for k, (row, column) in enumerate(np.ndindex(2, 2)):
            phases[row::2, column::2] = level[k]
        return self._frame(phases * self.light)

    def picture(self, texture, depth=np.inf, header=None):
        """The frame of a plane at `depth` [m] that the centre view sees as texture(x, y) -> RGB.

        In a lattice-aligned view of position a, infinity is displaced by +shift a, and a plane by
        -disparity a from there.
        """
        seen = self.place - (self.shift - self.disparity(depth)) * self.offset
        return self.from_colours(texture(seen[..., 0], seen[..., 1]), header)

    def from_colours(self, colours, header=None):
        """The frame of (height, width, 3) linear colours on the sensor's pixels."""
        mosaic = colours[..., 1].copy()
        mosaic[::2, ::2] = colours[::2, ::2, 2]
        mosaic[1::2, 1::2] = colours[1::2, 1::2, 0]
        return self._frame(mosaic * self.light, header)

    def _frame(self, values, header=None):
        counts = np.clip(np.rint(BLACK + (WHITE - BLACK) * values), 0, 4095).astype(np.uint16)
        return RawFrame(header or Header(), counts, self.metadata)


def whole_text(text, serial):
    """The frame's JSON `text` as in a .TXT of the camera of that serial number."""
    frame = {'metadata': json.loads(text), 'privateMetadata': {'camera': {'serialNumber': serial}}}
    return json.dumps({'master': {'picture': {'frameArray': [{'frame': frame}]}}})


def waves(x, y):
    """Linear RGB in [0.2, 0.8] of up to 0.05 cycles per px."""
    phase = 2 * np.pi * np.stack([0.045 * x + 0.02 * y, 0.05 * y - 0.01 * x,
                                  0.03 * (x - y)], axis=-1)
    return 0.5 + 0.3 * np.sin(phase + np.arange(3))


def spot(x0, y0, sigma=2.0):
    """A texture: a Gaussian spot at a pixel."""
    def texture(x, y):
        value = 0.8 * np.exp(-((x - x0) ** 2 + (y - y0) ** 2) / (2 * sigma ** 2))
        return np.repeat(value[..., None], 3, axis=-1)
    return texture
