"""Draws what the contour map says of a picture: no calibration, no object, no pose."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_map import harmonics

_WIDEST = 640  # px: of each of the three parts
_DIRECTIONS = 32  # that are compared: hues 11 degrees apart
_CONTOUR, _INSIDE = 6.0, 4.0  # nat that are drawn the brightest


def contour_map_picture(picture: NDArray[np.uint8], ratios: NDArray[np.float32]
                        ) -> NDArray[np.uint8]:
    """(height, 3 width, 3) RGB: the picture, its occluding contours, the inside of solids.

    picture: (H, W, 3) RGB. ratios: (H, W, 6) log odds ratios of `ContourNet` [nat]. A contour is
    as bright as the log odds of its likeliest direction; the hue is that of its outward normal:
    red to the right, green down, cyan to the left, violet up. The inside is grey at no evidence.
    """
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    by_direction = ratios[..., :5] @ harmonics(angles).T
    strength = by_direction.max(axis=-1) / np.float32(_CONTOUR)
    hue = np.rad2deg(angles).astype(np.float32)[by_direction.argmax(axis=-1)]
    colours = np.stack([hue, np.ones_like(hue), strength.clip(0, 1)], axis=-1)
    contours = cv2.cvtColor(colours, cv2.COLOR_HSV2RGB)
    inside = np.repeat((ratios[..., 5:] / (2 * _INSIDE) + 0.5).clip(0, 1), 3, axis=-1)
    parts = [picture, *(np.rint(255 * each).astype(np.uint8) for each in (contours, inside))]
    height, width = picture.shape[:2]
    if width > _WIDEST:
        size = _WIDEST, max(round(_WIDEST * height / width), 1)
        parts = [cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in parts]
    return np.concatenate(parts, axis=1)
