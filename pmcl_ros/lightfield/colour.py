"""Colours: white balance, and from a camera's linear RGB to that of a screen."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.runtime.errors import LightFieldError

_SATURATING = 0.95  # of the sensor's range: values above gradually count as lower bounds
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_NORM = 6  # Minkowski's; 1 would be the grey world, infinity the brightest pixel
_SATURATED, _DARK = 0.9, 0.005  # limits of the pixels that a white balance is estimated from
_LEAST = 100  # of these pixels


@dataclass(frozen=True)
class Colour:
    """Conversion of a camera's linear RGB to sRGB.

    gains: white balance, applied first.
    matrix: from the camera's primaries to those of sRGB, row by row; rows of sum 1 keep grey.
    """

    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    matrix: tuple[tuple[float, float, float], ...] = _IDENTITY

    @classmethod
    def from_metadata(cls, metadata: CameraMetadata) -> 'Colour':
        """White balance and matrix from a picture's metadata."""
        color = metadata.image.color
        gain, m = color.whiteBalanceGain, color.ccmRgbToSrgbArray
        return cls((gain.r, (gain.gr + gain.gb) / 2, gain.b), (m[:3], m[3:6], m[6:]))

    def displayed(self, linear: NDArray[np.floating], gamma: float) -> NDArray[np.uint8]:
        """(..., 3) uint8 RGB of (..., 3) linear RGB, 1 at the sensor's white, encoded by `gamma`.

        A saturated channel is only a lower bound. It is raised to the brightest of the three after
        the white balance: a pixel with three saturated channels becomes white, and a lamp with
        one saturated channel keeps its hue.
        """
        linear = np.asarray(linear, np.float32)
        balanced = linear * np.array(self.gains, np.float32)
        known = np.clip((1 - linear) / np.float32(1 - _SATURATING), 0, 1)
        known *= known * (3 - 2 * known)
        brightest = balanced.max(axis=-1, keepdims=True)
        balanced += (1 - known) * (brightest - balanced)
        shown = np.clip(balanced @ np.array(self.matrix, np.float32).T, 0, 1) ** np.float32(gamma)
        return np.round(255 * shown).astype(np.uint8)


NEUTRAL = Colour()  # of a camera with the primaries of sRGB


def shades_of_grey(view: NDArray[np.floating]) -> NDArray[np.float64]:
    """(3,) gains of red, green (1) and blue that make a view grey on average.

    view: (..., 3) linear RGB of the camera, 0 at black, 1 at the sensor's white.
    Minkowski mean of order 6, in which bright colours dominate (Finlayson, Trezzi: Shades of Gray
    and Colour Constancy, 2004), without saturated and dark pixels. It is wrong where bright
    surfaces are not grey. Raises LightFieldError when too few pixels remain.
    """
    colours = np.asarray(view, float).reshape(-1, 3)
    colours = colours[(colours.max(axis=1) < _SATURATED) & (colours.min(axis=1) > _DARK)]
    if len(colours) < _LEAST:
        raise LightFieldError(f'only {len(colours)} pixels are neither dark nor saturated, '
                              f'{_LEAST} are needed to estimate a white balance')
    means = np.mean(colours ** _NORM, axis=0) ** (1 / _NORM)
    return np.asarray(means[1] / means)
