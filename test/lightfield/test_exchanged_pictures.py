"""Pictures that were exchanged: told by what they show around the object, and by nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from textured_planes import around, views_of_planes

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.lightfield.exchanged_pictures import right_order
from pmcl_ros.lightfield.posed_view import PosedViews


def off(cameras, seed):
    """Poses (n, 4, 4) as those of a good arm: off by 1 mm and 0.2 degrees on each axis."""
    errors = np.random.default_rng(seed).normal(size=(len(cameras), 6))
    return cameras @ retract(np.tile(np.eye(4), (len(cameras), 1, 1)),
                             errors * np.repeat([0.001, 0.0035], 3))


def exchanged(views, one, other):
    """The views with two of their pictures exchanged."""
    made = list(views)
    made[one] = replace(views[one], picture=views[other].picture)
    made[other] = replace(views[other], picture=views[one].picture)
    return PosedViews(tuple(made))


@pytest.mark.parametrize('angles', [[-10, 10], [-20, 0, 20], [-24, -12, 0, 12, 24]])
@pytest.mark.parametrize('exact', [True, False])
def test_they_are_told_and_others_are_not(angles, exact):
    cameras = around(angles)
    views = views_of_planes(cameras, None if exact else off(cameras, 0))
    assert right_order(PosedViews(tuple(views))) is None
    for one in range(len(views) - 1):
        order = [*range(len(views))]
        order[one:one + 2] = one + 1, one
        assert right_order(exchanged(views, one, one + 1)) == tuple(order)


@pytest.mark.parametrize('angles', [[-20, 0, 20], [-30, -10, 25], [-24, -12, 0, 12, 24]])
@pytest.mark.parametrize('exact', [True, False])
@pytest.mark.parametrize('way', [-1, 1])
def test_a_shift_by_one_is_told(angles, exact, way):
    cameras = around(angles)
    told = np.roll(cameras if exact else off(cameras, 0), way, axis=0)
    order = right_order(PosedViews(tuple(views_of_planes(cameras, told))))
    assert order == tuple(np.roll(range(len(angles)), -way))


def test_a_shift_that_moves_all_cameras_alike_is_not_told():
    """On an arc of equal steps, each with the pose of the next: nothing in the pictures tells."""
    cameras = around([-20, 0, 20, 40])
    assert right_order(PosedViews(tuple(views_of_planes(cameras[:-1], cameras[1:])))) is None


def test_one_view_with_the_pose_of_the_one_before_it_is_no_shift():
    cameras = around([-20, 0, 20])
    views = views_of_planes(cameras, cameras[[0, 1, 1]])
    assert right_order(PosedViews(tuple(views))) is None


def test_a_camera_that_is_far_off_is_no_exchange():
    cameras = around([-20, 0, 20])
    told = cameras.copy()
    told[1] = told[1] @ retract(np.eye(4)[None], np.array([[0.02, 0.01, 0, 0.05, 0.05, 0]]))[0]
    assert right_order(PosedViews(tuple(views_of_planes(cameras, told)))) is None


@pytest.mark.parametrize('views', [
    views_of_planes(around([0])), views_of_planes(around([-10, 10]), contrast=0)],
    ids=['one', 'without texture'])
def test_without_matches_nothing_is_told(views):
    assert right_order(PosedViews(tuple(views))) is None


def test_what_fits_exchanged_poses_badly_is_not_told():
    # As the wrong matches of a pattern that repeats, which fit neither.
    cameras = around([-16, 16])
    seen = cameras[::-1].copy()
    seen[1] = seen[1] @ retract(np.eye(4)[None], np.array([[0, 0, 0, 0.012, 0, 0]]))[0]
    assert right_order(PosedViews(tuple(views_of_planes(seen, cameras)))) is None
