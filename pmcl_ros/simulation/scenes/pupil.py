"""Where the views of a plenoptic camera's pupil lie, and how much light each gets."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.light_field import nominal_positions

_REACH = 2.0  # view steps: the tent by which a decoder gathers a view's light ends there
_FINENESS = 20  # points per view step
_LEAST = 0.05  # light below which a view is black


def pupil_views(side: int, radius: float) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Positions (side, side, 2) [view steps] and weights (side, side), as `ViewGrid` has them.

    A view gathers light with a tent about its nominal place, as far as that lies in the pupil, a
    disc of `radius` view steps: outer views are darker, and sit nearer the axis.
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
