"""White images: to recognise one, and to remove vignetting with it."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.camera.white_images import BRIGHTEST_WHITE, DARKEST_WHITE
from pmcl_ros.lightfield.lenslets import DARKEST
from pmcl_ros.runtime.errors import LightFieldError

_BLOCK = 40  # raw px, even: some twenty lenslets
# Relative unevenness of blocks about a smooth surface: about 1 % in a white image, from cut
# lenslets; some ten times as much in other pictures.
_FLAT = 0.03


def relative_light(white: RawFrame) -> NDArray[np.float32]:
    """(height, width) float32: light at each pixel, relative to the maximum of its colour.

    Each of the four phases of the mosaic is divided by its own brightest level (99th percentile:
    the centres of lenslets): the colour of the white light does not tint the picture.
    Raises LightFieldError when the frame is no white image: too dark, or saturated where it is
    brightest.
    """
    light = white.linear()
    for row in (0, 1):
        for column in (0, 1):
            phase = light[row::2, column::2]
            brightest = float(np.percentile(phase[::4, ::4], 99))
            if not DARKEST_WHITE < brightest < BRIGHTEST_WHITE:
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
    return frame.linear() / np.maximum(light, np.float32(DARKEST))


def is_white_image(frame: RawFrame) -> bool:
    """Whether a frame is a white image.

    The camera's own mark (modulationFrame) decides. Without one the light must vary across the
    sensor as vignetting does, smoothly: a defocused white wall is a white image as well.
    """
    marked = frame.metadata.tags.modulationFrame
    return unevenness(frame) < _FLAT if marked is None else marked


def unevenness(frame: RawFrame) -> float:
    """Relative rms of the brightness of blocks about a surface of fourth order.

    Infinite for a frame that is too small or has no light.
    """
    rows, columns = (side // _BLOCK for side in frame.counts.shape)
    if min(rows, columns) < 6:
        return float('inf')
    counts = frame.counts[:rows * _BLOCK, :columns * _BLOCK]
    blocks = counts.reshape(rows, _BLOCK // 2, 2, columns, _BLOCK // 2, 2)
    means = blocks.mean(axis=(1, 4)) - frame.metadata.black  # (rows, 2, columns, 2), by phase
    phases = means.transpose(1, 3, 0, 2).reshape(4, -1)
    average = phases.mean(axis=1, keepdims=True)
    if (average <= 0).any():
        return float('inf')
    light = (phases / average).mean(axis=0)  # colours count alike
    y, x = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing='ij')
    terms = np.stack([(x ** a * y ** b).ravel() for a in range(5) for b in range(5 - a)], axis=1)
    smooth = terms @ np.linalg.lstsq(terms, light, rcond=None)[0]
    return float(np.sqrt(np.mean((light - smooth) ** 2)))
