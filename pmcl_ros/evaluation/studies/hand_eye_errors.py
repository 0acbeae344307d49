"""Errors of hand-eye calibrations by one simulated arm, beside those of closed forms."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import inverse, local
from pmcl_ros.geometry.sheet_pose import sheet_poses
from pmcl_ros.lightfield.calibration.hand_eye import hand_eye
from pmcl_ros.simulation.simulated_arm import SimulatedArm, simulated_arm

_INSIDE = 10.645  # 90 % of the chi-squared distribution of 6 degrees of freedom
_DRAWN = 50  # errors of each arm by the bound
_METHODS = 'Tsai', 'Park', 'Horaud', 'Andreff', 'Daniilidis'  # of OpenCV before 5


@dataclass(frozen=True)
class HandEyeErrors:
    """errors: (n, 6) of the camera by each method, as of `se3.local` [m, rad]: of one arm, and
    drawn by the bound. inside: whether the truth is in the 90 % region of the fit.
    """

    errors: dict[str, NDArray[np.float64]]
    inside: bool


def hand_eye_errors(seed: int, fixed_camera: bool) -> HandEyeErrors:
    """The errors of one arm. fixed_camera: the camera stands beside it, which holds the board."""
    arm = simulated_arm(np.random.default_rng(seed), fixed_camera=fixed_camera)
    found = hand_eye(arm.pictures, arm.board, arm.pinhole, None, fixed_camera)
    poses = {'fitted': found.camera, 'closed form': found.closed_form,
             **by_opencv(arm, fixed_camera)}
    errors = {name: local(arm.camera[None], pose) for name, pose in poses.items()}
    bound = hand_eye(arm.pictures, arm.board, arm.pinhole, arm.sigma, fixed_camera).covariance
    errors['Cramer-Rao bound'] = np.random.default_rng(seed).multivariate_normal(
        np.zeros(6), bound, _DRAWN)
    off, = errors['fitted']
    return HandEyeErrors(errors, bool(off @ np.linalg.solve(found.covariance, off) < _INSIDE))


def by_opencv(arm: SimulatedArm, fixed_camera: bool) -> dict[str, NDArray[np.float64]]:
    """The camera (4, 4), as `HandEye.camera`, by each of OpenCV's methods; OpenCV 5 has none."""
    calibrate = getattr(cv2, 'calibrateHandEye', None)
    if calibrate is None:
        return {}
    mounts = np.array([each.mount_to_base for each in arm.pictures])
    mounts = inverse(mounts) if fixed_camera else mounts
    boards = [sheet_poses(arm.board, each.corners, arm.pinhole)[0][0] for each in arm.pictures]
    found = {}
    for method in _METHODS:
        turn, place = calibrate(
            [each[:3, :3] for each in mounts], [each[:3, 3] for each in mounts],
            [each[:3, :3] for each in boards], [each[:3, 3] for each in boards],
            method=getattr(cv2, f'CALIB_HAND_EYE_{method.upper()}'))
        found[f'OpenCV, {method}'] = np.block([[turn, place.reshape(3, 1)], [np.eye(4)[3:]]])
    return found
