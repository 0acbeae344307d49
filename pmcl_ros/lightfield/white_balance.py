"""White balance where the camera's metadata tell none: estimated from the picture itself."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import LightFieldError

_NORM = 6  # Minkowski's; 1 would be the grey world, infinity the brightest pixel
_SATURATED, _DARK = 0.9, 0.005
_LEAST = 100  # pixels


def shades_of_grey(view: NDArray[np.floating]) -> NDArray[np.float64]:
    """(3,) gains of red, green (1) and blue that make a view grey on average.

    view: (..., 3) linear RGB of the camera, 0 at black, 1 at the sensor's white.
    The Minkowski mean of order 6, so that bright colours count most (Finlayson, Trezzi: Shades of
    Gray and Colour Constancy, 2004); saturated and dark pixels are left out. An estimate: wrong
    where what is bright in the picture is not grey.
    Raises LightFieldError when too few pixels are left.
    """
    colours = np.asarray(view, float).reshape(-1, 3)
    colours = colours[(colours.max(axis=1) < _SATURATED) & (colours.min(axis=1) > _DARK)]
    if len(colours) < _LEAST:
        raise LightFieldError(f'only {len(colours)} pixels are neither dark nor saturated, '
                              f'{_LEAST} are needed to estimate a white balance')
    means = np.mean(colours ** _NORM, axis=0) ** (1 / _NORM)
    return np.asarray(means[1] / means)
