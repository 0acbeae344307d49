"""Which corners of a board agree: against truth, with one that is seen aside, and with none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import local, pose_of
from pmcl_ros.lightfield.calibration.agreeing_corners import agreeing
from pmcl_ros.lightfield.calibration.fixed_cameras import camera_at_board
from pmcl_ros.runtime.errors import LightFieldError

PINHOLE = Pinhole(800, 600, 900, 900, 400, 300)
SIDE = np.array([[0.024 * x, 0.024 * y, 0] for y in range(5) for x in range(2)])
FAR = np.array([[0.12, 0.096, 0]])  # alone, so that it tells much of the tilt
POINTS = np.concatenate([SIDE, FAR])


def seen(rng, noise):
    """Corners [px] with noise, from anywhere above; the pose of the camera."""
    turn = (Rotation.from_euler('x', rng.uniform(120, 150), degrees=True)
            * Rotation.from_euler('z', rng.uniform(-180, 180), degrees=True))
    pose = pose_of(turn, [0, 0, 0.5])
    exact = PINHOLE.project(POINTS @ pose[:3, :3].T + pose[:3, 3])
    return exact + rng.normal(0, noise, exact.shape), np.linalg.inv(pose)


@pytest.mark.parametrize('noise', [0.05, 0.2])
def test_right_corners_are_seldom_left_out(noise):
    rng = np.random.default_rng(0)
    left = [agreeing(POINTS, seen(rng, noise)[0], PINHOLE, 8) for _ in range(300)]
    assert sum(len(each) < len(POINTS) for each in left) <= 9  # of 3 that are expected


def test_one_that_is_seen_aside_is_left_out_and_the_pose_is_then_right():
    rng, stated = np.random.default_rng(1), {False: [], True: []}
    for _ in range(50):
        corners, camera = seen(rng, 0.05)
        corners[-1] += 1.5 * rng.permutation([1, 0]) * rng.choice([-1, 1])
        kept = agreeing(POINTS, corners, PINHOLE, 8)
        for is_left_out, each in ((False, np.arange(len(POINTS))), (True, kept)):
            try:
                found = camera_at_board({'a': corners[each]}, POINTS[each], PINHOLE)
            except LightFieldError:  # the board fits nearly as well tilted the other way
                continue
            off = local(camera[None], found.camera)[0]
            stated[is_left_out].append(off @ np.linalg.solve(found.covariance, off) < 20)
    assert np.mean(stated[False]) < 0.5
    assert np.mean(stated[True]) > 0.85
    assert len(stated[True]) > 30


def test_too_few_are_left_as_they_are():
    corners, _ = seen(np.random.default_rng(2), 0.1)
    np.testing.assert_array_equal(agreeing(POINTS[:6], corners[:6], PINHOLE, 8), np.arange(6))
