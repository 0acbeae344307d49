"""From a camera's own linear colours to those of a screen."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.metadata import CameraMetadata

_SATURATING = 0.95  # of the sensor's range: from here to 1 a value turns into a lower bound
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Colour:
    """How to show linear RGB of a camera.

    gains: white balance: a grey under the picture's light has equal values after them.
    matrix: then from the camera's primaries to those of sRGB, row by row; rows of sum 1 keep grey
        grey.
    """

    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    matrix: tuple[tuple[float, float, float], ...] = _IDENTITY

    @classmethod
    def of(cls, metadata: CameraMetadata) -> 'Colour':
        """What the camera wrote beside a picture."""
        color = metadata.image.color
        gain, m = color.whiteBalanceGain, color.ccmRgbToSrgbArray
        return cls((gain.r, (gain.gr + gain.gb) / 2, gain.b), (m[:3], m[3:6], m[6:]))

    def displayed(self, linear: NDArray[np.floating], gamma: float) -> NDArray[np.uint8]:
        """(..., 3) uint8 RGB of (..., 3) linear RGB, 1 at the sensor's white, encoded by `gamma`.

        A saturated channel says only how bright it is at least. It is raised to the brightest of
        the three after the white balance: what saturates all channels is white, not of the
        colour of the gains, and a lamp whose one channel saturates keeps its hue.
        """
        linear = np.asarray(linear, np.float32)
        balanced = linear * np.array(self.gains, np.float32)
        known = np.clip((1 - linear) / np.float32(1 - _SATURATING), 0, 1)
        known *= known * (3 - 2 * known)
        brightest = balanced.max(axis=-1, keepdims=True)
        balanced += (1 - known) * (brightest - balanced)
        shown = np.clip(balanced @ np.array(self.matrix, np.float32).T, 0, 1) ** np.float32(gamma)
        return np.round(255 * shown).astype(np.uint8)


NEUTRAL = Colour()  # of a camera that has the primaries of a screen
