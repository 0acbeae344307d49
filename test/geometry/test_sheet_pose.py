"""The pose of a sheet by its corners in one picture: against truth, exact corners too."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.geometry.sheet_pose import sheet_pose, sheet_poses, tilts
from pmcl_ros.runtime.errors import LightFieldError

PINHOLE = Pinhole(640, 480, 600, 600, 319.5, 239.5)
STILL = np.zeros(4)
COLUMNS, ROWS = np.meshgrid(0.02 * np.arange(10), 0.02 * np.arange(7))
SHEET = np.stack([COLUMNS.ravel(), ROWS.ravel(), np.zeros(70)], axis=1)
MIDDLE = SHEET.mean(axis=0)


def seen(pose, points=SHEET):
    return PINHOLE.project(points @ pose[:3, :3].T + pose[:3, 3])


def straight(rng, way, turn):
    """A pose (4, 4) of the sheet straight before the camera, often in the middle of the picture.

    way, turn: seen from above (0) or from below (180), and turned about the optical axis [deg].
    """
    turned = Rotation.from_euler('xz', [way, turn], degrees=True).as_matrix()
    aside = rng.uniform(-0.05, 0.05, 2) * rng.integers(0, 2, 2)
    return pose_of(turned, [*aside, rng.choice([0.4, 0.5, 0.6, 0.779])] - turned @ MIDDLE)


@pytest.mark.parametrize('turn', [0, 90, 180, 37])
@pytest.mark.parametrize('way', [0, 180])
def test_exact_corners_of_a_sheet_that_is_straight_before_the_camera_tell_its_pose(way, turn):
    rng = np.random.default_rng(turn + way)
    for _ in range(40):
        truth = straight(rng, way, turn)
        vectors = sheet_pose(SHEET, seen(truth), PINHOLE.matrix, STILL)
        found = pose_of(Rotation.from_rotvec(vectors[0]), vectors[1])
        # Tilts by a root of the rounding make no difference that corners show.
        np.testing.assert_allclose(found, truth, atol=1e-5)
        poses, squares = sheet_poses(SHEET, seen(truth), PINHOLE)
        np.testing.assert_allclose(poses, [truth], atol=1e-5)
        assert squares == pytest.approx([0], abs=1e-8)


def test_of_exact_corners_one_tilt_is_the_truth_and_the_other_mirrors_it_about_the_sight():
    rng = np.random.default_rng(3)
    for _ in range(40):
        turned = Rotation.from_euler('zxz', rng.uniform([-180, 20, -180], [180, 60, 180]),
                                     degrees=True).as_matrix()
        place = np.array([*rng.uniform(-0.1, 0.1, 2), 0.6])
        truth = pose_of(turned, place - turned @ MIDDLE)
        found = [pose_of(Rotation.from_rotvec(turn), origin) for turn, origin
                 in tilts(SHEET, seen(truth), PINHOLE.matrix, STILL)]
        off = [np.abs(each - truth).max() for each in found]
        assert len(found) == 2
        assert min(off) < 1e-5
        sight, other = place / np.linalg.norm(place), found[int(np.argmax(off))]
        # The middle is at the same place, and the normals lie on either side of the sight.
        np.testing.assert_allclose(other[:3, :3] @ MIDDLE + other[:3, 3], place, atol=1e-5)
        normals = [each[:3, 2] for each in (truth, other)]
        across = [each - (each @ sight) * sight for each in normals]
        np.testing.assert_allclose(across[0], -across[1], atol=1e-5)
        assert normals[0] @ sight == pytest.approx(normals[1] @ sight, abs=1e-5)


@pytest.mark.parametrize('p1', [30, 1e3, 1e6])
def test_a_lens_by_which_corners_are_nowhere_tells_no_pose(p1):
    corners = seen(straight(np.random.default_rng(0), 0, 20)) + 100
    with pytest.raises(LightFieldError, match='those of no board'):
        sheet_pose(SHEET, corners, PINHOLE.matrix, np.array([0, 0, p1, -30, 0]))


@pytest.mark.parametrize('beside', [0, 1])
def test_points_on_a_line_and_one_beside_it_tell_no_pose(beside):
    points = SHEET[:10 + beside]
    truth = straight(np.random.default_rng(0), 0, 20)
    assert sheet_poses(points, seen(truth, points), PINHOLE) == ([], [])
    with pytest.raises(LightFieldError, match='those of no board'):
        sheet_pose(points, seen(truth, points), PINHOLE.matrix, STILL)
