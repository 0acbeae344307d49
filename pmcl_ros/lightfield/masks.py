"""Masks: where pictures show what is no evidence, as a gripper that moves with the camera."""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.readers.pictures import Reduction, read_picture
from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.runtime.errors import LightFieldError


def read_mask(path: Path) -> NDArray[np.bool_]:
    """(height, width), False where a picture is black. Raises LightFieldError as `read_picture`,
    and where it is black everywhere.
    """
    if not os.path.isfile(path):  # which takes any name
        raise LightFieldError(f'there is no {path}, which is to be a mask; one that leaves out '
                              'nothing is white everywhere')
    mask = np.asarray(read_picture(path).any(axis=2))
    if not mask.any():
        raise LightFieldError(f'{path}: the mask is black everywhere, so that nothing would '
                              'count: it is white where pictures show the scene')
    return mask


def check_size(mask: NDArray[np.bool_], pinhole: Pinhole, name: str) -> None:
    """Raise LightFieldError where a mask is of another size than its camera's pictures.

    name: of the mask, the picture or the camera, for the error.
    """
    height, width = mask.shape
    if (width, height) != (pinhole.width, pinhole.height):
        raise LightFieldError(
            f'{name}: the mask has {width}x{height} px, its camera {pinhole.width}x'
            f'{pinhole.height}: give a mask of the size of the pictures')


def mask_of_view(mask: NDArray[np.bool_], lens: Lens, wanted: Pinhole, reduction: Reduction,
                 name: str) -> NDArray[np.bool_]:
    """A mask of a camera's pictures as a view has it: without distortion, and shrunk.

    wanted: the pinhole of the view, before it is shrunk. name: as of `check_size`. Raises
    LightFieldError for another size, and where the view would show nothing that counts.
    """
    check_size(mask, lens.pinhole, name)
    seen = reduction.shrunk_mask(lens.undistorted_mask(mask, wanted))
    if not seen.any():
        raise LightFieldError(f'{name}: the mask leaves nothing of the view of {wanted.width}x'
                              f'{wanted.height} px'
                              + f', shrunk by {reduction.shrink}' * (reduction.shrink > 1))
    return seen
