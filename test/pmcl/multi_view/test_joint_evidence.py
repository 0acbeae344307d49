"""What several views hold of a region, in the frame of the first that sees it."""

from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import random_poses
from scipy.spatial.transform import Rotation
from test_multi_view import CUP, MIDDLE, ROI, around, maps_seen, settings, truth_of

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer

FRAME = pose_of(Rotation.from_euler('xyz', [170, 20, -40], degrees=True), [0.5, -0.2, 0.9])


@pytest.fixture
def joint(context):
    """A function cameras (n, 4, 4), sigma [m, rad] -> their evidence; of no object."""
    edges = maps_seen(context, CUP, truth_of(CUP), around([0]))

    def joint(cameras, sigma=(0.0, 0.0), middle=MIDDLE):
        views = tuple(replace(edges.views[0], camera_to_reference=each, sigma=sigma)
                      for each in cameras)
        return JointEvidence.from_views(replace(edges, views=views), NumbaRenderer(), CUP,
                                        settings(middle))

    return joint


def test_feasible_is_what_lies_in_the_region_of_the_reference_frame(joint):
    cameras = FRAME @ around([20, -20])
    centre = FRAME[:3, :3] @ MIDDLE + FRAME[:3, 3]
    poses = random_poses(300, 1)
    poses[:, :3, 3] = centre + np.random.default_rng(0).uniform(-0.6, 0.6, (300, 3)) * ROI
    inside = (np.abs(poses[:, :3, 3] - centre) <= 0.5 * np.array(ROI)).all(axis=1)
    assert 100 < inside.sum() < 250
    np.testing.assert_array_equal(
        joint(cameras, middle=centre).feasible(np.linalg.inv(cameras[0]) @ poses), inside)


def test_views_that_are_spread_are_the_first_and_those_farthest_from_it_and_each_other(joint):
    several = joint(around([0, 0, 30, 0, -5, -25]))
    assert several.spread(1) == [0]
    assert several.spread(2) == [0, 2]
    assert several.spread(3) == [0, 2, 5]
    assert several.spread(6) == several.spread(9) == [*range(6)]  # each once
    aside = np.tile(np.eye(4), (3, 1, 1))  # of one direction
    aside[:, 0, 3] = 0, 0.03, -0.06
    assert joint(aside).spread(2) == [0, 2]


def test_an_error_of_a_camera_is_seen_the_smaller_the_farther_it_is(joint):
    far = np.eye(4)
    far[2, 3] = -0.45  # twice as far
    near, farther = joint([np.eye(4), far], (1e-3, 0.0)).uncertain
    assert near == pytest.approx(2 * farther, rel=0.05)
    assert near > 0
