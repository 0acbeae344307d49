"""Where the bundle adjustment begins."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.sheet_pose import tilts
from pmcl_ros.lightfield.calibration.lytro.camera_model import predict
from pmcl_ros.lightfield.calibration.lytro.observations import Observations
from pmcl_ros.runtime.errors import LightFieldError

_BASELINE, _FOCUS = 7e-4, 2.0  # m, 1/m: typical of an F01, used where corners give no estimate


def initial_guess(observations: Observations, width: int,
                  height: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The camera (8,) and the poses (n, 6), nearly right; width, height: of a view.

    A distant plane looks nearly the same when it is tilted to the other side: the disparities
    decide. Raises LightFieldError when the positions of the corners are those of no
    planes.
    """
    seen = [(observations.points[valid].astype(np.float32),
             values[valid, :2].astype(np.float32))
            for valid, values in zip(observations.valid, observations.values, strict=True)]
    fixed = (cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_PRINCIPAL_POINT
             | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2
             | cv2.CALIB_FIX_K3)
    try:
        _, matrix, _, turns, origins = cv2.calibrateCamera(
            [points for points, _ in seen], [pixels for _, pixels in seen], (width, height),
            np.eye(3), np.zeros(5), flags=fixed)
        either = [[np.concatenate(each) for each
                   in tilts(points, pixels, np.asarray(matrix, float), np.zeros(5))]
                  for points, pixels in seen]
    except cv2.error as error:
        raise LightFieldError(
            f'the corners of the boards are those of no plane ({error.err}); are --corners and '
            '--square those of the board?') from None
    camera = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], _BASELINE, _FOCUS,
                       0, 0])
    poses = np.array([np.concatenate([turn.ravel(), origin.ravel()])
                      for turn, origin in zip(turns, origins, strict=True)])
    camera = _with_baseline(observations, camera, poses)
    for board, candidates in enumerate(either):
        found = np.array([*candidates, poses[board]])
        off = predict(observations.points, camera, found) - observations.values[board]
        off = off[:, observations.valid[board], 2:]
        # The slope over the board depends on the tilt, the middle on the distance.
        off = np.abs(off - np.median(off, axis=1, keepdims=True))
        poses[board] = found[np.median(off, axis=(1, 2)).argmin()]
    return _with_baseline(observations, camera, poses), poses


def _with_baseline(observations: Observations, camera: NDArray[np.float64],
                   poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """The camera with the baseline and the focus that explain the disparities of boards at poses.

    The disparity fx baseline (focus - 1 / z) is a line over 1 / z.
    """
    camera = camera.copy()
    apart = np.array([0.0, 0, 0, 0, 1, 0, 0, 0]) + camera * [1, 1, 1, 1, 0, 0, 0, 0]
    inverse = -predict(observations.points, apart, poses)[..., 2:][observations.valid]
    measured = observations.values[..., 2:][observations.valid]
    focal = camera[0]
    line = np.stack([np.full(inverse.size, focal), -inverse.ravel()], axis=1)
    (offset, baseline), *_ = np.linalg.lstsq(line, measured.ravel(), rcond=None)
    if baseline > 0 and offset > 0:
        camera[4:6] = baseline, offset / baseline
    return camera
