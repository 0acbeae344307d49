"""Modes: which poses are of one mode, which stand for it, and which poses are ambiguous."""

import numpy as np
import pytest
from pmcl_scenes import bracket, cup, model_of, random_poses

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import retract, rotation_angle
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.estimate import PoseEstimate, PoseMode
from pmcl_ros.pmcl.modes import SAME_MODE, ambiguous_poses, copy_beside, suppress_duplicates

NONE = Symmetry()
ROUND = Symmetry(np.array([0, 0, 1.0]))
UPSIDE_DOWN = np.diag([1.0, -1, -1, 1])
TURNED = Symmetry(None, np.stack([np.eye(4), UPSIDE_DOWN]))


def around(pose, count, distance, angle, rng):
    """Poses off by less than these, in any direction."""
    off = rng.normal(size=(count, 2, 3))
    off *= rng.random((count, 2, 1)) / np.linalg.norm(off, axis=2, keepdims=True)
    return retract(pose, np.concatenate([distance * off[:, 0], angle * off[:, 1]], axis=1))


def test_of_each_mode_the_best_is_kept():
    rng = np.random.default_rng(0)
    poses = random_poses(6, 0)
    poses[:, 0, 3] = 0.1 * np.arange(6)
    members = np.concatenate([around(pose, 5, 0.004, 0.05, rng) for pose in poses])
    # In an order in which the first of mode k is at place k.
    order = np.concatenate([np.arange(0, 30, 5), rng.permutation(np.delete(np.arange(30), slice(
        0, None, 5)))])
    assert suppress_duplicates(members[order], NONE, 30) == list(range(6))
    assert suppress_duplicates(members[order], NONE, 4) == list(range(4))
    assert suppress_duplicates(members[:0], NONE, 4) == []


def test_duplicates_are_found_whatever_a_symmetry_off_the_origin_does_to_the_place():
    off = UPSIDE_DOWN.copy()
    off[:3, 3] = 0, 0.1, 0.06  # half a turn about an axis beside the origin
    symmetry = Symmetry(None, np.stack([np.eye(4), off]))
    rng = np.random.default_rng(1)
    poses = random_poses(4, 2)
    poses[:, 0, 3] = 0.4 * np.arange(4)
    same = np.concatenate([around(pose, 5, 0.002, 0.02, rng) for pose in poses @ off])
    assert np.linalg.norm(same[:5, :3, 3] - poses[0, :3, 3], axis=1).min() > 0.1
    assert suppress_duplicates(np.concatenate([poses, same]), symmetry, 30) == list(range(4))
    assert suppress_duplicates(np.concatenate([poses, same]), NONE, 5) == list(range(5))


def test_poses_that_a_symmetry_makes_alike_are_of_one_mode():
    pose = random_poses(1, 3)[0]
    spun = pose.copy()
    spun[:3, :3] = pose[:3, :3] @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    others = np.stack([pose, spun, pose @ UPSIDE_DOWN])
    assert NONE.same_mode(others, pose, *SAME_MODE).tolist() == [True, False, False]
    assert ROUND.same_mode(others, pose, *SAME_MODE).tolist() == [True, True, False]
    assert TURNED.same_mode(others, pose, *SAME_MODE).tolist() == [True, False, True]


CUP = model_of(cup(), [0, 0, 1])
STANDING = model_of(cup().apply_translation([0, 0, 0.05]), [0, 0, 1])
BRACKET = model_of(bracket().apply_translation([0.03, 0.02, -0.01]))


@pytest.mark.parametrize('model', [STANDING, BRACKET], ids=['symmetric', 'whole'])
@pytest.mark.parametrize('seed', range(6))
def test_rivals_are_rigid_and_keep_the_middle_in_place(model, seed):
    pose = random_poses(1, seed)[0]
    found = ambiguous_poses(model, pose)
    middle = (model.vertices.min(axis=0) + model.vertices.max(axis=0)) / 2
    turns = found[:, :3, :3]
    np.testing.assert_allclose(turns @ turns.swapaxes(1, 2),
                               np.tile(np.eye(3), (len(found), 1, 1)), atol=1e-7)
    np.testing.assert_allclose(np.linalg.det(turns), 1)
    np.testing.assert_allclose(turns @ middle + found[:, :3, 3],
                               np.tile(pose[:3, :3] @ middle + pose[:3, 3], (len(found), 1)),
                               atol=1e-9)
    assert (rotation_angle(found, pose) > 1e-3).all()


def test_without_symmetry_half_turns_are_about_its_own_axes_and_the_line_of_sight():
    for pose in random_poses(20, 4):
        found = ambiguous_poses(BRACKET, pose)[:, :3, :3]
        own = pose[:3, :3].T @ found[:3]
        np.testing.assert_allclose(own, [np.diag(2 * each - 1) for each in np.eye(3)], atol=1e-9)
        turn = found[3] @ pose[:3, :3].T
        middle = pose[:3, :3] @ [0.03, 0.02, -0.01] + pose[:3, 3]
        sight = middle / np.linalg.norm(middle)
        np.testing.assert_allclose(turn, 2 * np.outer(sight, sight) - np.eye(3), atol=1e-9)


def test_an_axis_is_turned_upside_down_and_away():
    for pose in random_poses(20, 3):
        axes = ambiguous_poses(CUP, pose)[:, :3, :3] @ CUP.axis
        axis = pose[:3, :3] @ CUP.axis
        middle = pose[:3, 3]  # the cup's own
        sight = middle / np.linalg.norm(middle)
        np.testing.assert_allclose(axes[0], -axis, atol=1e-7)
        np.testing.assert_allclose(axes[2], -axes[1], atol=1e-7)
        # The tilt is mirrored: the part across the line of sight stays.
        np.testing.assert_allclose(axes[1] @ sight, -axis @ sight, atol=1e-7)
        np.testing.assert_allclose(np.cross(axes[1] + axis @ sight * sight,
                                            axis - axis @ sight * sight), 0, atol=1e-7)


@pytest.mark.parametrize(('lost', 'place', 'score', 'told'), [
    (False, 0.1, 99.0, True), (True, 0.1, 99.0, False),
    (False, 0.1, 70.0, False),  # a likeness by chance
    (False, 0.01, 99.0, False)])  # nearer than another one can stand
def test_a_mode_beside_the_estimate_is_a_copy_where_it_is_as_evident(lost, place, score, told):
    model, pose = model_of(cup()), np.eye(4)
    pose[2, 3] = 0.5
    beside = pose.copy()
    beside[0, 3] = place
    upside_down = ambiguous_poses(model, pose)[0]
    modes = (PoseMode(pose, 1.0, 100.0), PoseMode(upside_down, 0.0, 99.5),
             PoseMode(beside, 0.0, score))
    estimate = PoseEstimate(Header(7, 'camera'), pose, np.eye(6), pose[None], np.zeros(1), 100.0,
                            lost, 'default', modes)
    assert copy_beside(model, estimate) is (modes[2] if told else None)
