"""A printed board of either kind, in pictures of a camera without distortion."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.bent_board import bent
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


class LyingBoard(NamedTuple):
    """points: (m, 3) its corners [m], in the frame of the plane through them. heights: (m, k) a
    root of the covariance of their z [m]. pictures: by name,
    (m, 2) the corners that agree on that [px], NaN: not seen.
    """

    points: NDArray[np.float64]
    heights: NDArray[np.float64]
    pictures: dict[str, NDArray[np.float64]]


def as_it_lies(board: Board, pictures: Mapping[str, NDArray[np.float64]], pinhole: Pinhole
               ) -> LyingBoard:
    """The board that rests in pictures, which paper bends.

    pictures: by name, (m, 2) corners as the board's `seen`, of a camera without
    distortion [px]. Those in which too few corners agree are left out.
    """
    near = dict(pictures) if isinstance(board, Checkerboard) else {
        name: each for name, seen in pictures.items()
        if (each := board.near_plane(seen)) is not None}
    if not near:
        return LyingBoard(board.points, np.zeros((len(board.points), 0)), {})
    found = bent(near, board.points, pinhole)
    return LyingBoard(found.points, found.heights, near if isinstance(board, Checkerboard) else {
        name: each for name, seen in near.items()
        if (each := board.agreeing(seen, pinhole, found.points)) is not None})


def clear_focal_error(pictures: Mapping[str, NDArray[np.float64]], board: Board, pinhole: Pinhole
                      ) -> tuple[float, float] | None:
    """What `focal_error` says of pictures of a board, by name, where that is clear, else None."""
    off, sigma = focal_error(pictures, board.points, pinhole)
    return (off, sigma) if abs(off) > _CLEAR * math.hypot(sigma, LARGEST_ERROR) else None
