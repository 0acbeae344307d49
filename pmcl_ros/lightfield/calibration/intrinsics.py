"""The camera matrix and distortion of an ordinary camera, from pictures of a board."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.bent_board import bent_with_camera, bent_with_lens
from pmcl_ros.lightfield.calibration.two_zooms import two_zooms
from pmcl_ros.runtime.errors import LightFieldError

FEWEST = 5  # pictures: with fewer, noise passes for distortion
_MOST_PIXELS = 2.0  # rms of the corners of a picture: more is another camera, zoom or focus
LARGEST_ERROR = 0.01  # of the focal length: depths are off by as much
_HALVED = 0.5  # mean square of the others' corners without a picture that does not fit them
_NO_BOARD = 0.05  # of the width: by so much no zoom puts corners off, but those of no board
_FEW = 0.25  # of the pictures: so many of another zoom are left out


@dataclass(frozen=True)
class Intrinsics:
    """distortion: k1, k2, p1, p2 of OpenCV's plumb_bob. sigma: (8,) standard deviations of fx, fy,
    cx, cy [px] and these. names: of the pictures. pixels: (n,) rms distances of their corners
    [px]. board: (m, 3) the corners as they lie [m]: paper is bent. left_out: names of the pictures
    that do not fit the others.
    """

    pinhole: Pinhole
    distortion: tuple[float, ...]
    sigma: NDArray[np.float64]
    names: tuple[str, ...]
    pixels: NDArray[np.float64]
    board: NDArray[np.float64]
    left_out: tuple[str, ...] = ()

    @property
    def camera(self) -> NDArray[np.float64]:
        """(8,) of which `sigma` are the standard deviations."""
        of = self.pinhole
        return np.array([of.fx, of.fy, of.cx, of.cy, *self.distortion])


def fit_intrinsics(pictures: Mapping[str, NDArray[np.float64]], board: NDArray[np.float64],
                   width: int, height: int) -> Intrinsics:
    """The camera that took the pictures, and how the board is bent that rests in them.

    It begins with OpenCV's calibrateCamera (Zhang 2000), which takes the board to be flat.

    pictures: by name, (m, 2) corners of a board [px], NaN: not seen. board: (m, 3) its corners
    [m]. width, height: of the pictures [px]. A picture without which the others fit clearly better
    is left out, and so are a few of another zoom.
    Raises LightFieldError for fewer than `FEWEST` pictures, where the corners are those of no
    board, of several cameras or of two zooms, and where they do not tell the focal length.
    """
    kept, left_out = dict(pictures), list[str]()
    flat, pixels = _of_flat(kept, board, width, height)
    while len(kept) > FEWEST:
        worst = int(pixels.argmax())
        others = kept.copy()
        del others[[*kept][worst]]
        camera, without = _of_flat(others, board, width, height)
        if np.square(without).mean() > _HALVED * np.square(np.delete(pixels, worst)).mean():
            break
        left_out.append([*kept][worst])
        kept, flat, pixels = others, camera, without
    if not pixels.max() < _NO_BOARD * width:  # nor does a bend
        raise _not_fitting([*kept], pixels)
    found = _fitted(kept, board, flat, width, height)
    # A bend may yield to zooms, where there are two, or be there beside them.
    is_bent = np.square(found.pixels).mean() < _HALVED * np.square(pixels).mean()
    zooms = None if is_bent else two_zooms(kept, board, flat)
    zooms = zooms or two_zooms(kept, found.board, found.camera)
    if zooms is not None:
        fewer = min(zooms.names, key=len)
        if len(fewer) > min(_FEW * len(kept), len(kept) - FEWEST):
            shorter, longer = map(_told, zooms.names)
            raise LightFieldError(
                f'{shorter} were taken with a focal length of about {zooms.focal[0]:.0f} px, '
                f'{longer} of about {zooms.focal[1]:.0f} px: was the zoom or the focus moved? '
                'Calibrate with the pictures of one')
        left_out += fewer
        found = _fitted({name: kept[name] for name in kept if name not in fewer}, board, flat,
                        width, height)
    _check(found)
    return replace(found, left_out=tuple(left_out))


def _not_fitting(names: Sequence[str], pixels: NDArray[np.float64]) -> LightFieldError:
    worst = int(pixels.argmax())
    return LightFieldError(f'{names[worst]}: the corners are {pixels[worst]:.1f} px off: are all '
                           'pictures of one camera, with the same zoom and focus?')


def _check(found: Intrinsics) -> None:
    if not found.pixels.max() < _MOST_PIXELS:
        raise _not_fitting(found.names, found.pixels)
    unsure = float(found.sigma[0] / found.pinhole.fx)
    if not unsure < LARGEST_ERROR:
        raise LightFieldError(
            f'the focal length is known to {100 * unsure:.1f} % only, {100 * LARGEST_ERROR:g} % '
            'are needed: tilt the board by 20 to 40 degrees, another way in each picture, and '
            'bring it nearer')


def _told(names: tuple[str, ...]) -> str:
    return ', '.join(names[:8]) + ', ...' * (len(names) > 8)


class LensError(NamedTuple):
    """longer: the share by which the focal length is longer where boards fit best. aside: (2,) by
    what the principal point is aside [px]. sigma: (3,) standard deviations, by the corners alone.
    """

    longer: float
    aside: NDArray[np.float64]
    sigma: NDArray[np.float64]


def lens_error(pictures: Mapping[str, NDArray[np.float64]], board: NDArray[np.float64],
               pinhole: Pinhole) -> LensError:
    """How a camera differs from a pinhole, by boards that it sees.

    pictures: by name, (m, 2) corners of a board [px], NaN: not seen. board: (m, 3) its corners
    [m], z = 0.
    Raises LightFieldError where the corners are those of no board.
    """
    try:
        found = bent_with_lens(pictures, board, pinhole)
    except np.linalg.LinAlgError as error:
        raise _no_board(error) from None
    return LensError(float(found.camera[0] / pinhole.fx) - 1,
                     found.camera[2:4] - [pinhole.cx, pinhole.cy],
                     np.sqrt(np.diag(found.covariance)))


def _of_flat(pictures: Mapping[str, NDArray[np.float64]], board: NDArray[np.float64], width: int,
             height: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The camera (8,) by boards that are flat, and rms distances (n,) of the corners [px]."""
    if len(pictures) < FEWEST:
        raise LightFieldError(f'{len(pictures)} pictures show the board; a calibration needs '
                              f'{FEWEST}, better 15: is --corners or --ring that of the board?')
    shown = [np.isfinite(each).all(axis=1) for each in pictures.values()]
    points = [board[each].astype(np.float32) for each in shown]
    corners = [each[own].astype(np.float32)
               for each, own in zip(pictures.values(), shown, strict=True)]
    try:
        _, matrix, distortion, turns, places = cv2.calibrateCamera(
            points, corners, (width, height), np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3)
    except cv2.error as error:
        raise _no_board(error) from None
    camera = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2],
                       *distortion.ravel()[:4]], float)
    _check_focal_lengths(camera)  # OpenCV 4 returns NaN, OpenCV 5 raises
    off = [cv2.projectPoints(of, turn, place, matrix, distortion)[0][:, 0] - seen
           for of, seen, turn, place in zip(points, corners, turns, places, strict=True)]
    return camera, np.array([np.sqrt(np.square(each).sum(axis=1).mean()) for each in off])


def _fitted(pictures: Mapping[str, NDArray[np.float64]], board: NDArray[np.float64],
            start: NDArray[np.float64], width: int, height: int) -> Intrinsics:
    """start: (8,) of the camera."""
    try:
        found = bent_with_camera(pictures, board, start)
    except np.linalg.LinAlgError as error:
        raise _no_board(error) from None
    _check_focal_lengths(found.camera)
    fx, fy, cx, cy, *distortion = found.camera.tolist()
    return Intrinsics(Pinhole(width, height, fx, fy, cx, cy), tuple(distortion),
                      np.sqrt(np.diag(found.covariance)), tuple(pictures), found.pixels,
                      found.points)


def _check_focal_lengths(camera: NDArray[np.float64]) -> None:
    if not (camera[:2] > 0).all():
        raise _no_board(f'focal lengths of {camera[0]:.4g} and {camera[1]:.4g} px fit best')


def _no_board(why: object) -> LightFieldError:
    return LightFieldError(f'the corners are those of no board ({why}); is --corners or --ring '
                           'that of the board?'.replace('\n', ' '))
