"""A printed board of either kind, in pictures of a camera without distortion."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.bent_board import USUAL_ASIDE, bent
from pmcl_ros.lightfield.calibration.boards import Checkerboard
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.intrinsics import LARGEST_ERROR, lens_error
from pmcl_ros.lightfield.readers.pictures import Reduction

Board = Checkerboard | CharucoRing
_MOST_SEARCHED = 2 ** 21  # px: in larger pictures the detector takes seconds
_CLEAR = 3.0  # standard deviations of what pictures tell, with that of a calibration


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


def another_lens(pictures: Mapping[str, NDArray[np.float64]], board: Board, pinhole: Pinhole
                 ) -> str | None:
    """The lens by which pictures of a board, by name, fit best, where it clearly is another one.

    pictures: as of `as_it_lies`.
    """
    found = lens_error(pictures, board.points, pinhole)
    told = []
    if abs(found.longer) > _CLEAR * math.hypot(found.sigma[0], LARGEST_ERROR):
        told.append(f'a focal length that is {100 * abs(found.longer):.0f} % '
                    f'{"longer" if found.longer > 0 else "shorter"} (standard deviation '
                    f'{100 * found.sigma[0]:.1f})')
    usual = USUAL_ASIDE * pinhole.fx
    if (np.abs(found.aside) > _CLEAR * np.hypot(found.sigma[1:], usual)).any():
        told.append(f'a principal point that is ({found.aside[0]:.0f}, {found.aside[1]:.0f}) px '
                    f'aside (standard deviations {found.sigma[1]:.0f} and {found.sigma[2]:.0f})')
    return ' and '.join(told) or None
