"""Proposals of objects without an axis, refined, on edge volumes that show one."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pmcl_scenes import CAMERA, bracket, cup, depth_of, edges_seen, model_of, random_poses
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import EdgeVolume, depth_labels
from pmcl_ros.header import Header
from pmcl_ros.lightfield.geometry import Pinhole
from pmcl_ros.pmcl.contour_profile import ContourProfile
from pmcl_ros.pmcl.proposals import Proposals
from pmcl_ros.pmcl.refined_proposals import refined_proposals
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.summary import moved, rotation_distance, same_mode

DEPTHS = depth_labels(0.3, 0.7, 20)
REGION = Region((0, 0, 0.4), (0.1, 0.1, 0.16))
PROFILE = ContourProfile.learned()
BRACKET = model_of(bracket())
HALF_TURNS = np.tile(np.eye(4), (4, 1, 1))
HALF_TURNS[1:, :3, :3] = Rotation.from_rotvec(np.pi * np.eye(3)).as_matrix()
BOX = replace(model_of(trimesh.creation.box((0.09, 0.06, 0.035))), discrete=HALF_TURNS)


def scene(context, model, pose, seed=0):
    """Its contour, and noise."""
    edges = edges_seen(depth_of(context, model, pose, CAMERA, 4), CAMERA, DEPTHS,
                       0.2 * model.radius)
    rng = np.random.default_rng(seed)
    noise = 0.1 * rng.random((*edges.tensor.shape[:3], 1)) * [1, 1, 0]
    return replace(edges, tensor=(edges.tensor + noise).astype(np.float32))


def off(model, poses, truth):
    """(n,) m and rad, modulo the object's symmetries."""
    poses = model.symmetry.folded(poses, truth)
    return (np.linalg.norm(poses[:, :3, 3] - truth[:3, 3], axis=1),
            rotation_distance(poses, truth, None))


@pytest.mark.parametrize('model', [BRACKET, BOX], ids=['bracket', 'box'])
def test_refined_proposals_are_in_place(context, model):
    found, before = [], []
    for seed in range(1):
        truth = random_poses(1, seed, depth=(0.34, 0.46))[0]
        edges = scene(context, model, truth, seed)
        proposals = Proposals(NumbaRenderer(), model, REGION)
        raw, _ = proposals.propose(edges, 12)
        poses, scores = proposals.propose(edges, 12, PROFILE)
        assert 1 <= len(poses) == len(scores) <= 12
        assert (np.diff(scores) <= 0).all()
        assert REGION.contains(poses[:, :3, 3]).all()
        for k, pose in enumerate(poses):
            folded = model.symmetry.folded(poses, pose)
            assert same_mode(folded, pose, None, 0.012, 0.2).sum() == 1, k
        for each, kept in ((raw, before), (poses, found)):
            shift, turn = off(model, each, truth)
            kept.append(((shift < 0.006) & (turn < np.deg2rad(3))).any())
    assert all(found)
    assert not all(before)  # it is the refinement


def test_objects_with_an_axis_are_proposed_as_they_were(context):
    model = model_of(cup(), [0, 0, 1])
    edges = scene(context, model, random_poses(1, 0)[0])
    proposals = Proposals(NumbaRenderer(), model, REGION)
    for one, other in zip(proposals.propose(edges, 6), proposals.propose(edges, 6, PROFILE),
                          strict=True):
        np.testing.assert_array_equal(one, other)


def test_poses_stay_in_the_region(context):
    truth = random_poses(1, 3, depth=(0.38, 0.42))[0]
    edges = scene(context, BOX, truth)
    # The box itself lies just outside.
    region = Region(tuple(truth[:3, 3] + [0.012, 0, 0]), (0.02, 0.02, 0.04))
    start = moved(truth, np.array([[0.004, 0, 0, 0.03, 0.05, -0.04], [0.01, 0, 0, 0, 0, 0.3]]))
    poses, scores = refined_proposals(BOX, region, edges, PROFILE, None, start, 2)
    assert region.contains(poses[:, :3, 3]).all()
    there, evidence = refined_proposals(BOX, REGION, edges, PROFILE, None, start, 2)
    assert off(BOX, there[:1], truth)[0][0] < 0.006
    assert evidence[0] > max(scores[0], 0)


def test_images_smaller_than_a_cell_are_searched():
    tensor = np.random.default_rng(0).random((2, 3, 3, 3)).astype(np.float32)
    edges = EdgeVolume(Header(), tensor, depth_labels(0.3, 0.6, 3),
                       Pinhole(3, 2, 300, 300, 1.5, 1))
    poses, scores = Proposals(NumbaRenderer(), BOX, REGION).propose(edges, 3, PROFILE)
    assert 1 <= len(poses) <= 3
    assert np.isfinite(poses).all()
    assert np.isfinite(scores).all()
