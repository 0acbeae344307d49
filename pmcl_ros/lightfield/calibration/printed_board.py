"""A printed board of either kind, in pictures of a camera without distortion."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.boards import Checkerboard
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.intrinsics import LARGEST_ERROR, focal_error
from pmcl_ros.lightfield.readers.pictures import Reduction

Board = Checkerboard | CharucoRing
_MOST_SEARCHED = 2 ** 21  # px: in larger pictures the detector takes seconds
_CLEAR = 3.0  # standard deviations of the focal length, with that of a calibration


def reduction_for(width: int, height: int) -> Reduction:
    """Of a picture in which a board is looked for."""
    return Reduction(1, math.ceil(math.sqrt(width * height / _MOST_SEARCHED)))


def corners_seen(board: Board, picture: NDArray[np.uint8], pinhole: Pinhole
                 ) -> NDArray[np.float64] | None:
    """(m, 2) px of the corners in a grey picture, as the board's `seen`.

    NaN, too: corners that glass shows aside. None: it does not show the board.
    """
    seen = board.seen(picture)
    if seen is None or isinstance(board, Checkerboard):
        return seen
    return board.in_plane(seen, pinhole)


def clear_focal_error(pictures: Mapping[str, NDArray[np.float64]], board: Board, pinhole: Pinhole
                      ) -> tuple[float, float] | None:
    """What `focal_error` says of pictures of a board, by name, where that is clear, else None."""
    off, sigma = focal_error(pictures, board.points, pinhole)
    return (off, sigma) if abs(off) > _CLEAR * math.hypot(sigma, LARGEST_ERROR) else None
