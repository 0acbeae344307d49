"""The cost volume as one writes it first: numpy, and cv2.warpAffine for each view and label."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.planes import LUMINANCE
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.lightfield.light_field import ViewGrid

_WARP = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


def channels(views: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Colours (..., height, width, 3) in [0, 1], and x and y gradients of the grey (..., 2)."""
    colours = views / np.float32(255)
    grey: NDArray[np.float32] = colours @ LUMINANCE
    border = [(0, 0)] * (grey.ndim - 2) + [(1, 1), (1, 1)]
    grey = np.pad(grey, border, mode='edge')
    return colours, np.stack([(grey[..., 1:-1, 2:] - grey[..., 1:-1, :-2]) / 2,
                              (grey[..., 2:, 1:-1] - grey[..., :-2, 1:-1]) / 2], axis=-1)


def costs(colours: NDArray[np.float32], gradients: NDArray[np.float32], grid: ViewGrid,
          depths: NDArray[np.float64], settings: DlvSettings) -> NDArray[np.float32]:
    """C(x, l) of the paper's section V.A, (labels, height, width); a label's slices by warping.

    Bilinear, in cv2's coordinates (which it may round to 1/32 px); views count alike, and samples
    outside a view take its border's value.
    """
    pairs = StereoPairs.of(grid, settings.views)
    shifts, gammas = pairs.shifts(depths), pairs.gamma
    size = grid.pinhole.width, grid.pinhole.height
    volume = np.zeros((len(depths), *size[::-1]), np.float32)
    for label, cost in enumerate(volume):
        for (row, column), shift, gamma in zip(pairs.indices, shifts[:, label], gammas,
                                               strict=True):
            move = np.column_stack([np.eye(2), shift])
            seen, slopes = (cv2.warpAffine(each[row, column], move, size, flags=_WARP,
                                           borderMode=cv2.BORDER_REPLICATE)
                            for each in (colours, gradients))
            apart = seen - colours[grid.centre]
            colour = (np.linalg.norm(apart, axis=-1) if settings.color_cost == 'l2'
                      else np.abs(apart).sum(axis=-1))
            steep = np.minimum(np.abs(slopes - gradients[grid.centre]), settings.tau_gradient)
            cost += (settings.beta * np.minimum(colour, settings.tau_color)
                     + (1 - settings.beta) * (gamma * steep[..., 0] + (1 - gamma) * steep[..., 1]))
        cost[:] = cv2.boxFilter(cost, -1, (settings.window, settings.window), normalize=False,
                                borderType=cv2.BORDER_CONSTANT)
    return volume


def log_likelihood(volume: NDArray[np.float32]) -> NDArray[np.float32]:
    """log((max_l C - C) / sum_l C + 1), (height, width, labels)."""
    share = (volume.max(axis=0) - volume) / volume.sum(axis=0)
    return np.ascontiguousarray(np.log1p(share).transpose(1, 2, 0))
