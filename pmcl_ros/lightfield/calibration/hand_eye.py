"""Hand-eye calibration: where a camera is on an arm, or beside it, from pictures of a board.

The transform and the board's pose are fitted together to what the pictures and the arm say, each
weighted by its errors: a motion of the arm's flange and the noise of the corners. The closed form
of Park and Martin (1994) is where the fit starts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc, chdtri, fdtrc

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, local, retract
from pmcl_ros.geometry.sheet_pose import sheet_poses
from pmcl_ros.lightfield.calibration.arm_motions import (
    OTHERWISE,
    fits_inverses,
    mismatch,
    motions,
    park_martin,
    warn_of_scale,
)
from pmcl_ros.lightfield.posed_view import check_pose
from pmcl_ros.runtime.errors import LightFieldError

FEWEST = 6  # pictures
_LEAST_SPREAD = np.deg2rad(8)  # of the rotations about the second of their axes, rms
_UNLIKELY = 1e-4  # chance of a picture whose arm pose or board fits so badly
_FIRST_SIGMA = np.repeat([1e-3, 2e-3], 3)  # m, rad: of the arm, where nothing is told
_ROUNDS = 60  # of estimating the arm's errors
_FREEDOM = 3  # of Student's t-distribution: the less, the less a wrong picture counts
_STEP = 1e-6  # m, rad: of derivatives
_MISMATCH = np.deg2rad(15)  # in the median: by so much no arm's turns differ from the boards'
_BoardPose = tuple[NDArray[np.float64], NDArray[np.float64], float]  # of `_board_poses`


@dataclass(frozen=True)
class BoardPicture:
    """The corners of a board in one picture, and the arm's pose.

    corners: (m, 2) px, without distortion; NaN: not seen. mount_to_base: (4, 4), of the link with
    the camera, or with the board where the camera stands beside the arm.
    """

    name: str
    corners: NDArray[np.float64]
    mount_to_base: NDArray[np.float64]


@dataclass(frozen=True)
class HandEye:
    """camera: (4, 4) camera to the mount; of a camera beside the arm: to the base.

    covariance: (6, 6) of it, as of `se3.retract` [m^2, rad^2]. board: (4, 4) of the board in the
    base; of a camera beside the arm: in the mount. closed_form: what `park_martin` finds.
    sigma: of the arm's poses on each axis [m, rad]: those told, or estimated.
    pixels: (n,) rms distance of the corners from the board seen alone [px]. motions: (n, 6) by
    which the arm's poses are off [m, rad]. left_out: names of pictures that do not fit.
    left_pixels: (k,) as `pixels` of these. left_motions: (k, 6) by which the arm's poses are off
    if all the rest is as found.
    """

    camera: NDArray[np.float64]
    covariance: NDArray[np.float64]
    board: NDArray[np.float64]
    closed_form: NDArray[np.float64]
    sigma: tuple[float, float]
    names: tuple[str, ...]
    pixels: NDArray[np.float64]
    motions: NDArray[np.float64]
    left_out: tuple[str, ...] = ()
    left_pixels: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    left_motions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 6)))


def hand_eye(pictures: Sequence[BoardPicture], board: NDArray[np.float64], pinhole: Pinhole,
             sigma: tuple[float, float] | None = None, fixed_camera: bool = False) -> HandEye:
    """Fit the hand-eye transform. Pictures that do not fit are left out: first those in which the
    board turned by another angle than the arm, then one after the other.

    board: (m, 3) its corners [m]. sigma: standard deviations of the arm's poses on each axis [m,
    rad]; None: estimated. fixed_camera: it stands beside the arm, which holds the board.
    Raises LightFieldError for fewer than `FEWEST` pictures, where more than a quarter do not fit,
    where all rotations of the arm have one axis: they do not tell where the camera is; and where
    the arm turned otherwise than the boards, as of a camera that is beside the arm and not on it,
    or moved by a multiple of what they say. Logs a warning where it moved by a few per cent more
    or less than they say.
    """
    for each in pictures:
        check_pose(each.mount_to_base, f'{each.name}: mount_to_base')
    _check(pictures, ())
    try:
        seen = [_board_poses(each, board, pinhole) for each in pictures]
        kept, boards = [*pictures], _resolved(pictures, seen, sigma, fixed_camera)
        found = _agreed(kept, boards, sigma, fixed_camera)
        warn_of_scale(*_arm_and_boards(kept, boards, fixed_camera))
        return found
    except np.linalg.LinAlgError:
        raise LightFieldError("no camera fits the boards and the arm's poses: the equations are "
                              'singular; take pictures with other turns of the arm') from None


def _agreed(kept: list[BoardPicture], boards: list[_BoardPose],
            sigma: tuple[float, float] | None, fixed: bool) -> HandEye:
    """The fit to the pictures that fit each other. Takes the others out of both lists."""
    most = len(kept) // 4
    left: list[tuple[BoardPicture, _BoardPose]] = []
    for number in _turned_otherwise(kept, boards)[::-1]:
        left.insert(0, (kept.pop(number), boards.pop(number)))
    left_out = [each.name for each, _ in left]
    if len(left_out) > most:
        names = ', '.join(left_out[:8]) + ', ...' * (len(left_out) > 8)
        raise LightFieldError(f'in {len(left_out)} of {len(left_out) + len(kept)} pictures '
                              f'({names}) {OTHERWISE}')
    if fits_inverses(*_arm_and_boards(kept, boards, fixed)):
        place = 'on the arm (without' if fixed else 'beside the arm (with'
        raise LightFieldError(
            'the arm turned otherwise than the boards in the pictures, but as they did for a '
            f'camera {place} --fixed-camera): is it there, or is mount_to_base the pose of the '
            'base in the link? It must be that of the link in the base')
    while True:
        _check(kept, left_out)
        chances = _chances(kept, boards, sigma, fixed)
        worst = int(chances.argmin())
        fits = chances[worst] * len(kept) > _UNLIKELY
        enough = len(left_out) >= most
        if (fits or enough) and (why := mismatch(*_arm_and_boards(kept, boards, fixed))):
            raise LightFieldError(why)
        if fits:
            found, _ = _fitted(kept, boards, sigma, fixed)
            return _with_left_out(found, left, fixed) if left else found
        if enough:
            raise LightFieldError(
                'more than a quarter of the pictures do not fit the others: '
                f'{", ".join([*left_out, kept[worst].name])}; are the poses those of the link, '
                'taken at rest, and is sigma what the arm can do?')
        left_out.append(kept[worst].name)
        left.append((kept.pop(worst), boards.pop(worst)))


def _arm_and_boards(pictures: Sequence[BoardPicture], boards: Sequence[_BoardPose], fixed: bool
                    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What `park_martin` takes."""
    arm = np.array([each.mount_to_base for each in pictures])
    return inverse(arm) if fixed else arm, np.array([each[0] for each in boards])


def _with_left_out(found: HandEye, left: Sequence[tuple[BoardPicture, _BoardPose]], fixed: bool
                   ) -> HandEye:
    """With the errors of the arm that alone would explain the boards of pictures left out."""
    arm = np.array([each.mount_to_base for each, _ in left])
    seen = np.array([each[0] for _, each in left])
    mounts = found.board @ inverse(seen) @ inverse(found.camera)
    return replace(found, left_out=tuple(each.name for each, _ in left),
                   left_pixels=np.array([each[2] for _, each in left]),
                   left_motions=local((mounts if fixed else inverse(mounts)) @ arm, np.eye(4)))


def _turned_otherwise(pictures: Sequence[BoardPicture], boards: Sequence[_BoardPose]
                      ) -> NDArray[np.intp]:
    """Numbers of pictures whose boards turned by other angles than the arm, as one upside down.

    Wherever the camera is, board and arm turn by the same angle from picture to picture.
    """
    moved, turned = motions(np.array([each.mount_to_base for each in pictures]),
                             np.array([each[0] for each in boards]))
    arm, board = (Rotation.from_matrix(each[:, :3, :3]).magnitude() for each in (moved, turned))
    first, second = np.triu_indices(len(pictures), 1)
    off = np.full((len(pictures), len(pictures)), np.nan)
    off[first, second] = off[second, first] = np.abs(arm - board)
    return np.flatnonzero(np.nanmedian(off, axis=1) > _MISMATCH)


def _check(pictures: Sequence[BoardPicture], left_out: Sequence[str]) -> None:
    without = f', {", ".join(left_out)} being left out' if left_out else ''
    if len(pictures) < FEWEST:
        raise LightFieldError(f'{len(pictures)} pictures with a board{without}; a hand-eye '
                              f'calibration needs {FEWEST}, better 20'
                              + ('' if pictures else '; are the numbers of --corners (inner '
                                 'corners) or --ring those of the board?'))
    turns = np.array([each.mount_to_base[:3, :3] for each in pictures])
    vectors = (Rotation.from_matrix(turns) * Rotation.from_matrix(turns).mean().inv()).as_rotvec()
    spread = np.linalg.svd(vectors, compute_uv=False) / np.sqrt(len(vectors))
    if spread[1] < _LEAST_SPREAD:
        raise LightFieldError(
            f'the arm turned by {np.rad2deg(spread[0]):.1f} degrees about one axis and by '
            f'{np.rad2deg(spread[1]):.1f} about the next{without}: the axes are parallel; turn '
            'it by 30 degrees and more about two')


def _board_poses(picture: BoardPicture, board: NDArray[np.float64], pinhole: Pinhole
                 ) -> list[_BoardPose]:
    """Board to camera (4, 4); derivatives (2 k, 6) of corners seen by `retract`; rms [px].

    Two, where the board fits nearly as well tilted the other way.
    """
    shown = np.isfinite(picture.corners[:, 0])
    board, corners = board[shown], picture.corners[shown]

    def project(each: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(pinhole.project(board @ each[:3, :3].T + each[:3, 3]))

    found = []
    for pose, square in zip(*sheet_poses(board, corners, pinhole), strict=True):
        ahead, behind = (retract(pose[None], way * _STEP * np.eye(6)) for way in (1, -1))
        slopes = np.stack([(project(one) - project(other)).ravel() / (2 * _STEP)
                           for one, other in zip(ahead, behind, strict=True)], axis=1)
        found.append((pose, slopes, float(np.sqrt(square / len(corners)))))
    if not found:
        raise LightFieldError(f'{picture.name}: the corners that are seen are nearly on one line: '
                              'show more of the board, or leave it out')
    return found


def _resolved(pictures: Sequence[BoardPicture], boards: Sequence[list[_BoardPose]],
              told: tuple[float, float] | None, fixed: bool) -> list[_BoardPose]:
    """Of boards that may be tilted either way the pose that fits the arm and the others."""
    best = [each[0] for each in boards]
    if all(len(each) == 1 for each in boards):
        return best
    found, _ = _fitted(pictures, best, told, fixed, heavy_tails=True)
    arm = np.array([each.mount_to_base for each in pictures])
    expected = inverse(found.camera) @ (arm if fixed else inverse(arm)) @ found.board
    off = [[np.linalg.norm(pose[:3, :3] - there[:3, :3]) for pose, _, _ in each]
           for each, there in zip(boards, expected, strict=True)]
    return [each[int(np.argmin(turned))] for each, turned in zip(boards, off, strict=True)]


def _chances(pictures: Sequence[BoardPicture], boards: Sequence[_BoardPose],
             told: tuple[float, float] | None, fixed: bool) -> NDArray[np.float64]:
    """(n,) chances of a right picture to fit as badly as each does."""
    # In a Gaussian fit wrong pictures move the result, and where the arm's errors are estimated
    # make these large, until they fit themselves; in one with heavy tails they count for little.
    squares = _fitted(pictures, boards, told, fixed, heavy_tails=True)[1]
    if told is not None:
        return np.asarray(chdtrc(6, squares))
    # Errors that are estimated, from few pictures say, make large squares likelier: Fisher's
    # distribution, not chi-squared. The median makes the scale that of most pictures.
    scale = max(np.median(squares) / chdtri(6, 0.5), 1)
    return np.asarray(fdtrc(6, 6 * len(pictures) - 12, squares / scale / 6))


def _fitted(pictures: Sequence[BoardPicture], boards: Sequence[_BoardPose],
            told: tuple[float, float] | None, fixed: bool, heavy_tails: bool = False
            ) -> tuple[HandEye, NDArray[np.float64]]:
    """The fit to all pictures, and (n,) squares of their residuals in standard deviations.

    heavy_tails: errors have Student's t-distribution, in place of a Gaussian one.
    """
    mounts, seen = _arm_and_boards(pictures, boards, fixed)
    pixels = np.array([each[2] for each in boards])
    noise = max(float(np.sqrt(np.square(pixels).mean() / 2)), 1e-3)  # px, on each axis
    corners = noise ** 2 * np.array([np.linalg.inv(slopes.T @ slopes) for _, slopes, _ in boards])
    closed_form = park_martin(mounts, seen)
    starts = mounts @ closed_form @ seen
    board = starts[len(starts) // 2]
    sigma = _FIRST_SIGMA if told is None else np.repeat(told, 3)
    camera, weights = closed_form, np.ones(len(mounts))
    for _ in range(_ROUNDS):
        camera, board, jacobian, whitened, motions, gains = _solved(
            camera, board, mounts, seen, corners, sigma, fixed, weights)
        squares = np.square(whitened).sum(axis=1) / weights
        before = *sigma, *weights
        if heavy_tails:
            weights = (_FREEDOM + 6) / (_FREEDOM + squares)
        if told is None:
            # Variances of the arm, by expectation maximisation.
            second = weights[:, None] * np.square(motions) + gains
            free = len(motions) * 6 / max(len(motions) * 6 - 12, 1)
            variances = free * np.array([second[:, :3].mean(), second[:, 3:].mean()])
            sigma = np.repeat(np.sqrt(variances.clip(1e-12)), 3)
        if np.allclose([*sigma, *weights], before, rtol=0.01):
            break
    covariance = np.linalg.inv(jacobian.T @ jacobian)[:6, :6]
    found = HandEye(camera, covariance, board, closed_form, (float(sigma[0]), float(sigma[3])),
                    tuple(each.name for each in pictures), pixels, motions)
    return found, squares


def _solved(camera: NDArray[np.float64], board: NDArray[np.float64], mounts: NDArray[np.float64],
            seen: NDArray[np.float64], corners: NDArray[np.float64], sigma: NDArray[np.float64],
            fixed: bool, weights: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Camera, board; derivatives (6 n, 12), whitened residuals (n, 6); motions and variances.

    weights: (n,) that the covariances of the pictures are divided by. The last two: (n, 6) of the
    arm's motions that fit best, and of what is left of their prior.
    """
    def expected(steps: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, n, 4, 4) board to camera after each of the steps (m, 12)."""
        moved, placed = retract(camera, steps[:, :6]), retract(board, steps[:, 6:])
        return np.asarray(inverse(moved)[:, None] @ inverse(mounts) @ placed[:, None])

    def off(there: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, n, 6) from there (m, n, 4, 4) to poses that are as many, or broadcast."""
        # A copy: SciPy 1.11 takes no array that is read-only.
        return local(np.array(np.broadcast_to(poses, there.shape)).reshape(-1, 4, 4),
                     there.reshape(-1, 4, 4)).reshape(*there.shape[:2], 6)

    # How a motion of the flange, in its own frame, moves the board before the camera.
    motion = retract(np.eye(4), _STEP * np.eye(6))[:, None]
    moved = inverse(camera) @ (inverse(mounts) @ inverse(motion) if fixed else
                               motion @ inverse(mounts)) @ board
    still = np.broadcast_to(expected(np.zeros((1, 12))), moved.shape)
    arm = np.moveaxis(off(still, moved) / _STEP, 0, -1)
    spread = corners + arm @ (np.square(sigma)[:, None] * arm.transpose(0, 2, 1))
    white = np.linalg.inv(np.linalg.cholesky(spread / weights[:, None, None]))

    def whitened(steps: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((white @ off(expected(steps), seen)[..., None])[..., 0]).reshape(
            len(steps), -1)

    def residuals(step: NDArray[np.float64]) -> NDArray[np.float64]:
        return whitened(step[None])[0]

    def jacobian(step: NDArray[np.float64]) -> NDArray[np.float64]:
        # All steps at once: one by one, as least_squares does, takes most of the time.
        aside = _STEP * np.eye(12)
        return (whitened(step + aside) - whitened(step - aside)).T / (2 * _STEP)

    solution = least_squares(residuals, np.zeros(12), jacobian,
                             x_scale=np.tile(_FIRST_SIGMA, 2))
    moved, placed = (retract(each, part[None])[0] for each, part in zip(
        (camera, board), np.split(solution.x, 2), strict=True))
    gain = np.square(sigma)[:, None] * arm.transpose(0, 2, 1) @ np.linalg.inv(spread)
    motions = (gain @ off(expected(solution.x[None]), seen)[0, ..., None])[..., 0]
    left = np.square(sigma) - np.einsum('nij,nji->ni', gain, arm) * np.square(sigma)
    return (moved, placed, solution.jac, residuals(solution.x).reshape(-1, 6), motions, left)
