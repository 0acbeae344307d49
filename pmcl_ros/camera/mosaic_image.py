"""RawFrame from a sensor mosaic that was saved as an 8-bit image, with derived metadata."""

import json
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import TILE, UPPER_LEFT, RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.runtime.errors import CameraError, PictureError, told_as
from pmcl_ros.runtime.picture_file import read_picture_file

_SUFFIXES = ('.png', '.jpg', '.jpeg')
_COUNTS = 16  # of 12 bits per level of 8 bits
_DARK = 1.0  # percent of the pixels that are taken as unlit
# The same for both first-generation cameras whose metadata are known (lytro_f01.md, B3):
# rows of the matrix from the camera's colours to linear sRGB, and the exponent of its display.
_TO_SRGB = (3.1116, -1.9394, -0.1722, -0.3629, 1.6409, -0.2780, 0.0790, -1.1558, 2.0768)
_GAMMA = 0.41666


def is_mosaic_image(path: Path | str) -> bool:
    """Whether the name of `path` is one that `read_mosaic_image` accepts."""
    return Path(path).suffix.lower() in _SUFFIXES


def read_mosaic_image(path: Path | str, gain: float = 1.0) -> RawFrame:
    """Read a BGGR mosaic saved as a one-channel 8-bit PNG or JPEG.

    gain: factor applied to the sensor's intensity when the image was saved: counts are
        16 / gain times the levels, and 255 becomes the white level.

    The level without light is that of the darkest 1 % of the pixels (the gaps between lenslets,
    where the scene is dark). The stamp is the file's modification time. The metadata are derived,
    not a camera's, and say so (`derived`): a generic first-generation Lytro's colour matrix and
    gamma, white balance unknown (gains of 1).
    Raises CameraError when the file cannot be read or is another kind of image.
    """
    path = Path(path)
    if not 0 < gain < 100:
        raise CameraError(f'{path}: a gain of {gain} is impossible; it must be positive')
    levels = _read_levels(path)
    black = float(np.percentile(levels, _DARK))
    if black == 255:
        raise CameraError(f'{path}: a black level of {black} of 255 is impossible; is the picture '
                          'saturated?')
    scale = _COUNTS / gain
    white = min(4095, round(255 * scale))
    counts = np.minimum(np.rint(levels * np.float32(scale)), white).astype(np.uint16)
    zero = min(round(black * scale), white - 1)
    text = _derived_text(counts.shape, zero, white, path.name, gain)
    return RawFrame(Header(path.stat().st_mtime_ns), counts, CameraMetadata.parse(text))


def _read_levels(path: Path) -> NDArray[np.uint8]:
    with told_as(CameraError, PictureError):
        levels = read_picture_file(path, cv2.IMREAD_UNCHANGED)
    if levels.ndim != 2 or levels.dtype != np.uint8:
        raise CameraError(
            f'{path} has {1 if levels.ndim == 2 else levels.shape[2]} channels of {levels.dtype}; '
            'the mosaic of a sensor is one channel of 8 bits. A developed colour picture holds no '
            'light field')
    return np.asarray(levels, np.uint8)


def _derived_text(shape: tuple[int, ...], black: int, white: int, name: str, gain: float) -> str:
    """The JSON of a frame, with the fields that can be derived."""
    colours = ('r', 'gr', 'gb', 'b')
    return json.dumps({
        'derived': {'from': name, 'gain': gain,
                    'note': 'made from an 8-bit mosaic, not written by a camera: colour matrix '
                            'and gamma are the usual ones, white balance is unknown, levels are '
                            "the image's"},
        'image': {
            'width': shape[1], 'height': shape[0], 'orientation': 1,
            'rawDetails': {
                'pixelFormat': {'black': dict.fromkeys(colours, black),
                                'white': dict.fromkeys(colours, white)},
                'mosaic': {'tile': TILE, 'upperLeftPixel': UPPER_LEFT}},
            'color': {'ccmRgbToSrgbArray': _TO_SRGB, 'gamma': _GAMMA,
                      'whiteBalanceGain': dict.fromkeys(colours, 1.0)}},
        'camera': {'model': 'F01'}}, indent=1)
