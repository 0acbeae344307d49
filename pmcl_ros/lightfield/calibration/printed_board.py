"""A printed board of either kind, in pictures of a camera without distortion."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.bent_board import USUAL_ASIDE, BentBoard, bent
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.intrinsics import LARGEST_ERROR, lens_error
from pmcl_ros.lightfield.readers.pictures import Reduction

Board = Checkerboard | CharucoRing
_MOST_SEARCHED = 2 ** 21  # px: in larger pictures the detector takes seconds
_TOUCHED = 1e-6  # mm above the plane: what the solver leaves
_ASIDE = 0.1 * np.array([[0.9, 0.4], [-0.4, 0.9], [-0.9, -0.4], [0.4, -0.9]])  # of half a sheet
_CLEAR = 3.0  # standard deviations of what pictures tell, with that of a calibration


def reduction_for(width: int, height: int) -> Reduction:
    """Of a picture in which a board is looked for."""
    return Reduction(1, math.ceil(math.sqrt(width * height / _MOST_SEARCHED)))


class LyingBoard(NamedTuple):
    """points: (m, 3) its corners [m]; z = 0 is the table. heights: (m, k) a root of the covariance
    of their z [m]. pictures: by name, (m, 2) the corners that agree on that [px], NaN: not seen.
    """

    points: NDArray[np.float64]
    heights: NDArray[np.float64]
    pictures: dict[str, NDArray[np.float64]]


def as_it_lies(board: Board, pictures: Mapping[str, NDArray[np.float64]], pinhole: Pinhole
               ) -> LyingBoard:
    """The board that rests in pictures, on a table that touches it from below; paper bends.

    pictures: by name, (m, 2) corners as the board's `seen`, of a camera without distortion [px].
    Those in which too few corners agree are left out.
    Raises LightFieldError for corners that are those of no board.
    """
    near = dict(pictures) if isinstance(board, Checkerboard) else {
        name: each for name, seen in pictures.items()
        if (each := board.near_plane(seen)) is not None}
    if not near:
        return LyingBoard(board.points, np.zeros((len(board.points), 0)), {})
    # Corners of paper that is curled may be as far off a plane as those behind glass: what is
    # common to several pictures is the paper, and in a single one what fits all of its corners.
    seen = {name: pictures[name] for name in near}
    found = _lying(board, seen, near, pinhole)
    is_paper = len(near) > 1 or _number(found.pictures) == _number(seen)
    return found if is_paper else _lying(board, near, near, pinhole)


def _lying(board: Board, seen: Mapping[str, NDArray[np.float64]],
           near: Mapping[str, NDArray[np.float64]], pinhole: Pinhole) -> LyingBoard:
    """By the corners that are seen in pictures; near: those by which their poses begin."""
    found = bent(seen, board.points, pinhole, near)
    sigma = np.linalg.norm(found.heights, axis=1)
    less = np.eye(len(sigma)) - _shown(found) * _plane_below(
        found.points[:, :2], board.up * found.points[:, 2] + sigma)
    points = np.concatenate([found.points[:, :2], less @ found.points[:, 2:]], axis=1)
    if isinstance(board, Checkerboard):
        return LyingBoard(points, less @ found.heights, dict(seen))
    kept = {}
    for (name, corners), off in zip(seen.items(), found.off, strict=True):
        each = board.near(corners, off)
        each = None if each is None else board.agreeing(each, pinhole, points)
        if each is not None:
            kept[name] = each
    return LyingBoard(points, less @ found.heights, kept)


def _number(pictures: Mapping[str, NDArray[np.float64]]) -> int:
    """Of corners that are seen."""
    return sum(int(np.isfinite(each[:, 0]).sum()) for each in pictures.values())


def _shown(found: BentBoard) -> float:
    """Which share of the bend is no noise, 0 to 1 (James and Stein, 1961)."""
    square = np.square(np.linalg.pinv(found.heights) @ found.points[:, 2]).sum()
    return max(0.0, 1 - found.heights.shape[1] / float(square)) if square > 0 else 0.0


def _plane_below(places: NDArray[np.float64], heights: NDArray[np.float64]
                 ) -> NDArray[np.float64]:
    """(m, m) what gives, of heights (m,), those of the plane on which a sheet of them rests.

    places: (m, 2), and heights there (m,) [m]. It touches the sheet from below, and is the nearest
    on average, as by the weight. A gutter or a saddle rocks from one such plane to the other, by
    noise too: the weight is taken to be a little aside, each way, and the planes are averaged.
    """
    terms = np.concatenate([places, np.ones((len(places), 1))], axis=1)
    middle, reach = terms.mean(axis=0), np.ptp(places, axis=0) / 2
    plane = np.zeros((len(terms), len(terms)))
    for x, y in reach * _ASIDE:
        found = linprog(-middle - [x, y, 0], A_ub=terms, b_ub=1e3 * heights,  # mm
                        bounds=(None, None))
        touched = np.flatnonzero(found.slack < _TOUCHED)
        plane[:, touched] += terms @ np.linalg.pinv(terms[touched]) / len(_ASIDE)
    return plane


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
