"""Where cameras at rest are, in the frame of a board at rest that all of them see."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, retract
from pmcl_ros.geometry.sheet_pose import LEAST_NOISE, sheet_poses
from pmcl_ros.runtime.errors import LightFieldError

_STEP = 1e-6  # m, rad: of derivatives
_MOST_PIXELS = 2.0  # rms of the corners: more is a board that moved, or another lens
_USUAL_NOISE = 0.05  # px, on each axis


@dataclass(frozen=True)
class CameraAtBoard:
    """camera: (4, 4) camera to the board. covariance: (6, 6) of it, as of `se3.retract`
    [m^2, rad^2]. names: of the pictures. pixels: (n,) rms distances of their corners from where
    the board is expected [px].
    """

    camera: NDArray[np.float64]
    covariance: NDArray[np.float64]
    names: tuple[str, ...]
    pixels: NDArray[np.float64]

    def sigma_beside(self, board: NDArray[np.float64]) -> tuple[float, float]:
        """Standard deviations of position [m] and rotation [rad] on each axis, as of `PosedView`.

        With errors of the position and of the rotation that are independent, what is beside the
        board (m, 3) [m] is seen as far off as by this covariance. It is much less than the
        covariance's own diagonal says: camera and board turn about the board together.
        """
        middle = board.mean(axis=0)
        beside = middle + np.ptp(board, axis=0).max() * np.concatenate([np.eye(3), -np.eye(3)])
        places = beside - self.camera[:3, 3]
        slopes = np.concatenate([np.tile(np.eye(3), (len(places), 1, 1)),
                                 np.cross(np.eye(3), places[:, None]).swapaxes(1, 2)], axis=2)
        variance = np.einsum('nij,jk,nik->', slopes, self.covariance, slopes) / slopes[..., 0].size
        position = float(np.sqrt(variance / 2))
        return position, position / float(np.linalg.norm(self.camera[:3, 3] - middle))


def camera_at_board(pictures: Mapping[str, NDArray[np.float64]], board: NDArray[np.float64],
                    pinhole: Pinhole, heights: NDArray[np.float64] | None = None
                    ) -> CameraAtBoard:
    """The camera that sees the corners of a board so; camera and board rest.

    pictures: by name, (m, 2) corners without distortion [px], NaN: not seen. board: (m, 3) its
    corners [m]; z is small. heights: (m, k) a root of the covariance of these z [m], which are
    exact without it. The noise of the corners is estimated from what is left of them.
    Raises LightFieldError where a picture shows none, where no pose fits the corners, where they
    are on one line, and where another pose, with the board tilted the other way, fits nearly as
    well.
    """
    seen = np.array([*pictures.values()])
    shown = np.isfinite(seen).all(axis=2)
    if not shown.any(axis=1).all():
        raise LightFieldError(f'{[*pictures][int(shown.any(axis=1).argmin())]} shows no corner of '
                              'the board')
    corners, points = seen[shown], np.tile(board, (len(seen), 1, 1))[shown]
    poses, squares = sheet_poses(points, corners, pinhole)
    if not poses:
        raise LightFieldError(f'{", ".join(pictures)}: the corners that are seen are nearly on '
                              'one line: show more of the board')

    def residuals(camera: NDArray[np.float64], there: NDArray[np.float64] = board
                  ) -> NDArray[np.float64]:
        """(n, m, 2) px, 0 of corners that are not seen."""
        back = inverse(camera)
        off = pinhole.project(there @ back[:3, :3].T + back[:3, 3]) - seen
        return np.where(shown[..., None], off, 0)

    camera = inverse(poses[0])
    left = residuals(camera)
    pixels = np.sqrt(np.square(left).sum(axis=(1, 2)) / shown.sum(axis=1))
    if not pixels.max() < _MOST_PIXELS:
        raise LightFieldError(
            f'{[*pictures][int(pixels.argmax())]}: the corners are {pixels.max():.1f} px off: did '
            'board and camera rest, and is the calibration of this camera and resolution?')
    if len(poses) > 1:
        raise LightFieldError(
            f'{", ".join(pictures)}: the board fits nearly as well tilted the other way: tilt it, '
            'or bring it nearer')
    # Errors in units of an estimated noise are Student's: from few corners, larger than Gaussian.
    # A few may fit by chance: two more residuals, as a good detector leaves them, count with them.
    freedom = max(corners.size - 6, 3)
    variance = max((squares[0] + 2 * _USUAL_NOISE ** 2) / (freedom - 2), LEAST_NOISE ** 2)
    ahead, behind = (retract(camera, way * _STEP * np.eye(6)) for way in (1, -1))
    slopes = np.stack([(residuals(one) - residuals(other)).ravel() / (2 * _STEP)
                       for one, other in zip(ahead, behind, strict=True)], axis=1)
    covariance = variance * np.linalg.inv(slopes.T @ slopes)
    if heights is not None:
        up = _STEP * np.array([0, 0, 1])
        rise = (residuals(camera, board + up) - residuals(camera, board - up)) / (2 * _STEP)
        moved = rise[..., None] * heights[:, None]
        follows = np.linalg.pinv(slopes) @ moved.reshape(len(slopes), -1)
        covariance += follows @ follows.T
    return CameraAtBoard(camera, covariance, tuple(pictures), pixels)
