"""A camera: its views in the pupil, exposure, blur, noise."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import ViewGrid, nominal_positions

_APERTURE = 0.0003  # m: a quarter of the width of a small one
_REACH = 2.0  # view steps: the tent by which a decoder gathers a view's light ends there
_FINENESS = 20  # points per view step
_LEAST = 0.05  # light below which a view is black
# Noise of a decoded F01: what white noise of the raw picture becomes (measured by decoding the
# same frame with and without it): neighbouring pixels correlate by 0.16, views by 0.03, colours
# not at all; red and blue sites are half as many, so their noise has twice the variance.
_NEIGHBOUR = 0.085  # of a kernel (k, 1, k) along both axes: correlation 2 k / (1 + 2 k^2)
_VARIANCE = np.array([2.0, 1.0, 2.0], np.float32)
_WHITE = 1.02  # a saturated sensor, after its vignetting was divided out


@dataclass(frozen=True)
class Sensor:
    """How a camera turns light into the values of views.

    grid: the camera of the views. focus: depth without disparity before rectification, where
        views are sharp [m]. pupil: radius of the disc that all views share [view steps].
    blur: standard deviation of what lenslets and interpolation blur [px].
    level: mean of the centre view that the exposure aims at [1 at the sensor's white].
    shot: variance per value of green; red and blue have twice that. read: standard deviation in
        the dark of green. Both are for views of weight 1.
    gains: of the sensor's red, green, blue.
    """

    grid: ViewGrid
    focus: float
    pupil: float
    blur: float
    level: float
    shot: float
    read: float
    gains: tuple[float, float, float]


def one_view(pinhole: Pinhole, aperture: float = _APERTURE) -> ViewGrid:
    """The grid of an ordinary camera. aperture: a quarter of its width [m]."""
    return ViewGrid.of_one_view(pinhole, aperture)


def pupil_views(side: int, radius: float) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Positions (side, side, 2) [view steps] and weights (side, side) of views, as in `ViewGrid`.

    A view gathers light with a tent about its nominal position, cut off by the pupil, a disc of
    `radius` view steps: outer views are darker and lie nearer the axis.
    """
    nominal = nominal_positions(side, side)
    last = int(_REACH * _FINENESS)
    offsets = np.arange(-last, last + 1) / _FINENESS
    tent = 1 - np.abs(offsets) / _REACH
    kernel = tent[:, None] * tent
    points = nominal[..., None, None, :] + np.stack(np.meshgrid(offsets, offsets), axis=-1)
    light = kernel * ((points ** 2).sum(axis=-1) <= radius ** 2)
    total = light.sum(axis=(-2, -1))
    middle = (points * light[..., None]).sum(axis=(-3, -2)) / np.maximum(total, 1e-9)[..., None]
    weights = total / kernel.sum()
    dark = weights < _LEAST
    return np.where(dark[..., None], nominal, middle), np.where(dark, 0, weights).astype(
        np.float32)


def sensed(picture: NDArray[np.float32], gain: float, sigma: float, margin: int
           ) -> NDArray[np.float32]:
    """The picture (height, width, 3) times a gain, blurred, without its margin [px] on each side.

    sigma: of the Gaussian [px]. The sensor's pixels saturate one by one, before a decoder blurs
    them: 1 is white.
    """
    picture = np.minimum(picture * np.float32(gain), np.float32(_WHITE))
    if sigma > 0:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.float32)
    height, width = picture.shape[0] - 2 * margin, picture.shape[1] - 2 * margin
    return np.ascontiguousarray(picture[margin:margin + height, margin:margin + width])


def exposure(centre: NDArray[np.floating], level: float) -> float:
    """The gain that brings the mean of the centre view to `level`; less where it would saturate
    more than a fiftieth of the pixels.

    centre: (height, width, 3) radiances. level: as of `Sensor`.
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
