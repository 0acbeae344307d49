"""Undo the vignetting of lenslets and main lens with a white image."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.runtime.errors import LightFieldError

# Below this part of the light at a lenslet's centre a pixel holds more noise than picture: it is
# not brightened further.
_DARKEST = 0.05


def relative_light(white: RawFrame) -> NDArray[np.float32]:
    """(height, width) float32: the light each pixel got, 1 where its colour got most.

    Each of the four phases of the mosaic is divided by its own brightest level (99th percentile:
    the centres of lenslets), so that the colour of the white light does not tint the picture.
    Raises LightFieldError when the frame is no white image: too dark, or saturated where it is
    brightest.
    """
    light = _linear(white)
    for row in (0, 1):
        for column in (0, 1):
            phase = light[row::2, column::2]
            brightest = float(np.percentile(phase[::4, ::4], 99))
            if not 0.02 < brightest < 0.99:
                raise LightFieldError(
                    f'white image is at {100 * brightest:.0f} % of the range of the sensor where '
                    'it is brightest; it must be exposed well above black and below saturation')
            phase /= brightest  # in place: a view of `light`
    return light


def devignette(frame: RawFrame, light: NDArray[np.float32]) -> NDArray[np.float32]:
    """(height, width) float32, 0 at black, 1 at the sensor's white; brighter pixels are kept.

    light: of `relative_light`. Raises LightFieldError when it is of another size.
    """
    if frame.counts.shape != light.shape:
        raise LightFieldError(
            f'raw frame {frame.counts.shape} and white image {light.shape} differ in size')
    return _linear(frame) / np.maximum(light, np.float32(_DARKEST))


def _linear(frame: RawFrame) -> NDArray[np.float32]:
    """0 at black, 1 at the sensor's white."""
    black, white = frame.metadata.black, frame.metadata.white
    return (frame.counts - np.float32(black)) * np.float32(1 / (white - black))
