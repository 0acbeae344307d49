"""Motions of an arm and of the boards in its pictures: each pair of pictures tells one of either.

They give the camera on the arm in closed form, and tell where arm and pictures do not go together.
"""

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import inverse, local
from pmcl_ros.runtime.errors import LightFieldError

_LOG = logging.getLogger(__name__)
_WRONG_TURNS = np.deg2rad(4)  # in the median: arms are off by a tenth
OTHERWISE = (
    'the arm turned otherwise than the boards in the pictures: is mount_to_base the pose of the '
    'link in the base (not of the base in the link), are the poses those of these pictures, did '
    'the board stay as it was, and is --fixed-camera given for a camera beside the arm, and only '
    'for it?')
_CLEARLY = 3.0  # times: by so much motions fit better of a camera on the arm, or beside it
_REACH = 0.5  # m: of a board, at which turns and shifts count together
_ALIKE = 0.95  # correlation of two motions, one of which is a multiple of the other
_SCALES = 1 / 1.1, 1.1  # of the board, beyond which its squares or the arm's unit are others
_CLEAR_SCALE = 0.004, 5.0  # share, standard deviations: what a ruler does not tell is no mistake


def park_martin(mounts: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Camera to mount (4, 4), in closed form, of poses of the mount and of the board before it.

    mounts: (n, 4, 4) to the base. seen: (n, 4, 4) board to camera. Park and Martin, "Robot Sensor
    Calibration: Solving AX = XB on the Euclidean Group", 1994. OpenCV before 5
    has it as calibrateHandEye.
    """
    moved, turned = motions(mounts, seen)
    a, b = (Rotation.from_matrix(each[:, :3, :3]).as_rotvec() for each in (moved, turned))
    matrix = b.T @ a
    values, vectors = np.linalg.eigh(matrix.T @ matrix)
    rotation = vectors @ np.diag(1 / np.sqrt(values)) @ vectors.T @ matrix.T
    if not np.linalg.det(rotation) > 0:
        raise LightFieldError(OTHERWISE)
    left = (np.eye(3) - moved[:, :3, :3]).reshape(-1, 3)
    right = (moved[:, :3, 3] - turned[:, :3, 3] @ rotation.T).ravel()
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, np.linalg.lstsq(left, right, rcond=None)[0]
    return pose


def motions(mounts: NDArray[np.float64], seen: NDArray[np.float64]
            ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(k, 4, 4) motions of mount and board between all pairs of pictures, see `park_martin`."""
    first, second = np.triu_indices(len(mounts), 1)
    return inverse(mounts[second]) @ mounts[first], seen[second] @ inverse(seen[first])


def fits_inverses(mounts: NDArray[np.float64], seen: NDArray[np.float64]) -> bool:
    """Whether boards fit the inverses of the mount's poses much better than these.

    So they do where a camera beside the arm is taken for one on it, or the other way round.
    mounts, seen: as of `park_martin`.
    """
    return _misfit(mounts, seen) > _CLEARLY * _misfit(inverse(mounts), seen)


def _misfit(mounts: NDArray[np.float64], seen: NDArray[np.float64]) -> float:
    """Median distance of motions by the boards from the arm's [m]; infinite for no closed form."""
    try:
        camera = park_martin(mounts, seen)
    except LightFieldError:
        return np.inf
    moved, turned = motions(mounts, seen)
    off = np.linalg.norm(local(moved @ camera, camera @ turned).reshape(-1, 2, 3), axis=2)
    return float(np.median(off @ [1, _REACH]))


def mismatch(mounts: NDArray[np.float64], seen: NDArray[np.float64]) -> str:
    """Why pictures and arm, outliers left out, are not of one another; '' where they can be.

    mounts, seen: as of `park_martin`. Each pair of pictures tells a motion of either.
    """
    moved, turned = motions(mounts, seen)
    rotation = park_martin(mounts, seen)[:3, :3]
    by_board = Rotation.from_matrix(rotation @ turned[:, :3, :3] @ rotation.T)
    off = np.median((by_board.inv() * Rotation.from_matrix(moved[:, :3, :3])).magnitude())
    if off > _WRONG_TURNS:
        return OTHERWISE
    by_arm, by_boards = _along(moved, turned, rotation)
    sizes = np.linalg.norm(by_arm), np.linalg.norm(by_boards)
    if by_arm @ by_boards <= _ALIKE * sizes[0] * sizes[1]:
        return ''
    scale = sizes[0] / sizes[1]
    if _SCALES[0] < scale < _SCALES[1]:
        return ''
    size = f'{float(f"{scale:.3g}"):g}'  # 1000, not 1e+03
    return (f"by the arm's motions the board is {size} times as large as told: are the positions "
            'of mount_to_base in metres, and is --square the side of a square?')


def _along(moved: NDArray[np.float64], turned: NDArray[np.float64],
           rotation: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(3 k,) positions of motions by arm and boards, less what a place of the camera explains.

    What is left is nothing, where the camera always had the board at one place before it; else the
    arm's part and the board's are the same.
    """
    left = (np.eye(3) - moved[:, :3, :3]).reshape(-1, 3)
    by_arm, by_boards = (each - left @ np.linalg.lstsq(left, each, rcond=None)[0] for each in (
        moved[:, :3, 3].ravel(), (turned[:, :3, 3] @ rotation.T).ravel()))
    return by_arm, by_boards


def warn_of_scale(mounts: NDArray[np.float64], seen: NDArray[np.float64]) -> None:
    """Warn where the arm tells that the board is a few per cent larger or smaller than told.

    mounts, seen: as of `park_martin`. The fit takes it for errors of the arm, and puts the camera
    elsewhere.
    """
    # Of all: without one of them, the turns of the others may have one axis.
    rotation = park_martin(mounts, seen)[:3, :3]
    scale = _scale(mounts, seen, rotation)
    number = len(mounts)
    without = np.array([
        _scale(np.delete(mounts, each, axis=0), np.delete(seen, each, axis=0), rotation)
        for each in range(number)])
    sigma = np.sqrt((number - 1) * np.square(without - without.mean()).mean())  # the jackknife's
    least, times = _CLEAR_SCALE
    if abs(scale - 1) > max(least, times * sigma):
        _LOG.warning(
            "by the arm's motions the board is %.1f %% %s than told (standard deviation %.1f): "
            'measure ten of its squares for --square, and check the focal length; else the place '
            'of the camera is off by about this share of its distance from the board',
            100 * abs(scale - 1), 'larger' if scale > 1 else 'smaller', 100 * sigma)


def _scale(mounts: NDArray[np.float64], seen: NDArray[np.float64],
           rotation: NDArray[np.float64]) -> float:
    """Size of the board by the arm's motions, as a share of that told. rotation: (3, 3) of the
    camera in the mount.
    """
    by_arm, by_boards = _along(*motions(mounts, seen), rotation)
    return float(by_arm @ by_boards / (by_boards @ by_boards))
