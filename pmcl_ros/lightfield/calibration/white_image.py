"""Tells a white image from an ordinary picture."""

import numpy as np

from pmcl_ros.camera.raw_frame import RawFrame

_BLOCK = 40  # raw px, even: some twenty lenslets
# Relative brightness of blocks about a smooth surface: in a white image what the lenslets that a
# block cuts make of it (1 %), in a picture of anything some ten times as much.
_FLAT = 0.03


def is_white_image(frame: RawFrame) -> bool:
    """Whether a frame is a white image.

    The camera's own mark (modulationFrame) decides. Without one the light must vary across the
    sensor as vignetting does, smoothly: a defocused white wall is a white image as well.
    """
    marked = frame.metadata.tags.modulationFrame
    return unevenness(frame) < _FLAT if marked is None else marked


def unevenness(frame: RawFrame) -> float:
    """Of the brightness of blocks of the frame: relative rms about a surface of fourth order.

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
