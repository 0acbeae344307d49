"""Raw frames of any lattice of lenslets, computed by pixel."""

import json

import numpy as np

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice

BLACK, WHITE = 168, 4095


def make_lattice(pitch=9.93, ratio=0.8662, rotation=-0.005, centre=(201.3, 197.8)):
    return Lattice(pitch_px=pitch, row_step_px=ratio * pitch, rotation=rotation, centre_px=centre)


def pixels(side):
    """(side, side, 2) float: (x, y) of each pixel."""
    return np.indices((side, side))[::-1].transpose(1, 2, 0).astype(float)


def offsets(lattice, points):
    """(..., 2) px from the nearest lenslet's centre."""
    return points - lattice.centres(*lattice.nearest(points))


def discs(lattice, side, radius=0.46, cut=0.0, shear=0.0):
    """(side, side) light under lenslets, 1 at the centres.

    radius: of a disc, in pitches. cut: pitches by which, at the middle of an edge of the sensor,
    the main lens' rim has moved over the discs. shear: rad.
    """
    points = pixels(side)
    points[..., 0] += shear * (points[..., 1] - side / 2)
    apart = offsets(lattice, points)
    distance = np.hypot(*np.moveaxis(apart, -1, 0))
    light = np.clip(radius * lattice.pitch_px - distance + 0.5, 0, 1)
    light *= 1 - 0.3 * (distance / (radius * lattice.pitch_px)) ** 2
    if cut:
        field = points * 2 / side - 1
        rim = np.hypot(*np.moveaxis(apart + cut * lattice.pitch_px * field, -1, 0))
        light *= np.clip(1.2 * radius * lattice.pitch_px - rim + 0.5, 0, 1)
    return light


def frame_of(light, text, noise=0.01, seed=0, header=None):
    """The frame of (height, width) values, 1 at the sensor's white; text: function of its size."""
    random = np.random.default_rng(seed)
    noisy = light + noise * np.sqrt(np.maximum(light, 0.01)) * random.standard_normal(light.shape)
    counts = np.clip(np.rint(BLACK + (WHITE - BLACK) * noisy), 0, 4095).astype(np.uint16)
    metadata = CameraMetadata.parse(text(*light.shape[::-1]))
    return RawFrame(header or Header(), counts, metadata)


def mosaic(levels, side):
    """(side, side) of the four phases' levels (blue, green, green, red)."""
    return np.tile(np.reshape(levels, (2, 2)), (side // 2, side // 2))


def texture(side, size, seed=0, strength=0.7):
    """(side, side) a scene with details of `size` px, its median brightness 0.3."""
    spectrum = np.fft.fft2(np.random.default_rng(seed).standard_normal((side, side)))
    waves = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side))
    scene = np.fft.ifft2(spectrum * np.exp(-2 * (np.pi * size * waves) ** 2)).real
    return 0.3 * np.exp(strength * scene / scene.std())


def marked(text, **fields):
    """As `text`, a function of the size, with fields more in the frame's JSON."""
    return lambda width, height: json.dumps(json.loads(text(width, height)) | fields)
