"""What lenslets, exposure and noise make of the light of views."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.simulation.scenes.scene import Sensor

# Noise of a decoded F01: what white noise of the raw picture becomes (measured by decoding the
# same frame with and without it): neighbouring pixels correlate by 0.16, views by 0.03, colours
# not at all; red and blue sites are half as many, so their noise has twice the variance.
_NEIGHBOUR = 0.085  # of a kernel (k, 1, k) along both axes: correlation 2 k / (1 + 2 k^2)
_VARIANCE = np.array([2.0, 1.0, 2.0], np.float32)
_WHITE = 1.02  # a saturated sensor, after its vignetting was divided out


def sensed(picture: NDArray[np.float32], gain: float, sigma: float, margin: int
           ) -> NDArray[np.float32]:
    """The picture times a gain, without its margin, blurred by a Gaussian of sigma [px].

    The sensor's pixels saturate one by one, before a decoder blurs them.
    """
    picture = np.minimum(picture * np.float32(gain), np.float32(_WHITE))
    if sigma > 0:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.float32)
    height, width = picture.shape[0] - 2 * margin, picture.shape[1] - 2 * margin
    return np.ascontiguousarray(picture[margin:margin + height, margin:margin + width])


def exposure(centre: NDArray[np.floating], level: float) -> float:
    """The factor that brings the mean of the centre view to `level`.

    Less where a fiftieth of it would be saturated.
    """
    return float(min(level / max(centre.mean(), 1e-6),
                     0.95 / max(np.percentile(centre, 98), 1e-6)))


def noisy(view: NDArray[np.float32], weight: float, sensor: Sensor, rng: np.random.Generator
          ) -> NDArray[np.float32]:
    """A view (height, width, 3) with photon and read noise, saturated; black for weight 0.

    The variance is (shot value + read^2) / weight, in red and blue twice that.
    """
    if weight <= 0:
        return np.zeros_like(view)
    gains = np.array(sensor.gains, np.float32)
    view = view * gains
    sigma = np.sqrt((sensor.shot * np.maximum(view, 0) + sensor.read ** 2) * _VARIANCE / weight)
    height, width = view.shape[:2]
    field = rng.standard_normal((height + 2, width + 2, 3), np.float32)
    kernel = np.array([_NEIGHBOUR, 1, _NEIGHBOUR])
    kernel /= np.linalg.norm(kernel)
    field = np.asarray(cv2.sepFilter2D(field, -1, kernel, kernel)[1:-1, 1:-1], np.float32)
    return np.minimum(view + sigma * field, np.float32(_WHITE), dtype=np.float32)
