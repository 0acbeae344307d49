"""Simulated arms with a camera and a board, for the hand-eye calibration."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, pose_of, retract
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.hand_eye import BoardPicture

_TILT, _SPIN = 40.0, 20.0  # degrees: largest turns of the board, about two axes and the third


@dataclass(frozen=True)
class SimulatedArm:
    """camera: the true (4, 4), as `HandEye.camera`. sigma: true, of the arm [m, rad]."""

    camera: NDArray[np.float64]
    pictures: tuple[BoardPicture, ...]
    board: NDArray[np.float64]
    pinhole: Pinhole
    sigma: tuple[float, float]


def simulated_arm(rng: np.random.Generator, count: int = 20,
                  sigma: tuple[float, float] = (0.0005, np.deg2rad(0.1)), corners: float = 0.2,
                  fixed_camera: bool = False, distance: float = 0.5) -> SimulatedArm:
    """An arm that takes `count` pictures of a board so far away [m].

    sigma: of its poses on each axis [m, rad]. corners: standard deviation of these [px].
    """
    pinhole, board = Pinhole(640, 480, 600, 600, 320, 240), Checkerboard(10, 7, 0.02).points
    camera, placed = (_random(rng, reach) for reach in (0.05, 0.5))
    pictures = []
    for number in range(count):
        angles = rng.uniform(-1, 1, 3) * [_TILT, _TILT, _SPIN]
        turn = Rotation.from_euler('xyz', angles, degrees=True).as_matrix()
        seen = pose_of(turn, ([0, 0, distance] - turn @ board.mean(axis=0)
                              + rng.normal(0, 0.02, 3)))
        pixels = pinhole.project(board @ seen[:3, :3].T + seen[:3, 3])
        pixels = pixels + rng.normal(0, corners, pixels.shape)
        mount = (camera @ seen @ inverse(placed) if fixed_camera
                 else placed @ inverse(seen) @ inverse(camera))
        error = rng.normal(size=(1, 6)) * np.repeat(sigma, 3)
        pictures.append(BoardPicture(f'{number:03d}', pixels,
                                     mount @ retract(np.eye(4)[None], error)[0]))
    return SimulatedArm(camera, tuple(pictures), board, pinhole, sigma)


def _random(rng: np.random.Generator, reach: float) -> NDArray[np.float64]:
    turn = Rotation.from_quat(rng.normal(size=4))
    return pose_of(turn, rng.normal(0, reach, 3))
