"""Proposals, on edge volumes that show one object and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pmcl_scenes import CAMERA, bracket, cup, depth_of, edges_seen, model_of, random_poses

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.proposals import template_matching
from pmcl_ros.pmcl.proposals.template_matching import Proposals
from pmcl_ros.pmcl.proposals.templates import Templates
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.runtime.errors import LocalizationError

DEPTHS = depth_labels(0.3, 0.7, 20)
REGION = Region((0, 0, 0.4), (0.1, 0.1, 0.16))
CUP = model_of(cup(), [0, 0, 1])
# The same about x: an axis of symmetry need not be z.
LYING = model_of(cup().apply_transform(trimesh.transformations.rotation_matrix(
    np.pi / 2, [0, 1, 0])), [1, 0, 0])
BRACKET = model_of(bracket())


def scene(context, model, pose, camera=CAMERA):
    return edges_seen(depth_of(context, model, pose, camera, 4), camera, DEPTHS,
                      0.2 * model.radius)


def distances(poses, truth, axis):
    """Off aside [m], along the line of sight [m], in orientation [rad]."""
    sight = truth[:3, 3] / np.linalg.norm(truth[:3, 3])
    shift = poses[:, :3, 3] - truth[:3, 3]
    along = shift @ sight
    aside = np.linalg.norm(shift - along[:, None] * sight, axis=1)
    return aside, np.abs(along), Symmetry(axis).rotation_distance(poses, truth)


@pytest.mark.parametrize('seed', range(2))
@pytest.mark.parametrize('model', [CUP, LYING, BRACKET], ids=['cup', 'lying', 'bracket'])
def test_one_of_a_few_proposals_is_near_the_pose(context, model, seed):
    truth = random_poses(1, seed, depth=(0.34, 0.46))[0]
    edges = scene(context, model, truth)
    poses, scores = Proposals(NumbaRenderer(), model, REGION).propose(edges, 12)
    aside, along, turn = distances(poses, truth, model.axis)
    assert ((aside < 0.005) & (along < 0.015) & (turn < np.deg2rad(20))).any()
    assert len(poses) == len(scores) == 12
    assert (np.diff(scores) <= 0).all()
    assert scores[0] > 0
    assert REGION.contains(poses[:, :3, 3]).all()
    for k, pose in enumerate(poses):
        assert model.symmetry.same_mode(poses, pose, 0.012, 0.2).sum() == 1, k


def test_the_same_edges_give_the_same_proposals(context):
    edges = scene(context, CUP, random_poses(1, 0)[0])
    proposals = Proposals(NumbaRenderer(), CUP, REGION)
    first, second = proposals.propose(edges, 20), proposals.propose(edges, 20)
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


def test_an_object_that_is_partly_out_of_the_image_is_proposed(context):
    truth = random_poses(1, 1)[0]
    truth[:3, 3] = [-0.065, 0.05, 0.4]
    depth = depth_of(context, CUP, truth, CAMERA)
    assert (depth[:, 0] > 0).any()  # cut off by the border
    region = Region((-0.065, 0.05, 0.4), (0.06, 0.06, 0.08))
    poses, _ = Proposals(NumbaRenderer(), CUP, region).propose(scene(context, CUP, truth), 12)
    aside, along, turn = distances(poses, truth, CUP.axis)
    assert ((aside < 0.01) & (along < 0.02) & (turn < 0.5)).any()


@pytest.mark.parametrize(('camera', 'place'), [
    (Pinhole(237, 213, 720, 260, 120.5, 103.0), (0.01, -0.02, 0.4)),  # pixels far from square
    (Pinhole(201, 183, 320, 340, -30, 171), (0.16, -0.13, 0.4)),  # 27 degrees aside
])
@pytest.mark.parametrize('seed', range(2))
def test_any_camera_will_do(context, camera, place, seed):
    truth = random_poses(1, seed)[0]
    truth[:3, 3] = place
    depths = depth_labels(0.5 * place[2], 2 * place[2], 20)
    edges = edges_seen(depth_of(context, CUP, truth, camera, 4), camera, depths,
                       0.2 * CUP.radius)
    region = Region(tuple(np.add(place, 0.001)), (0.05, 0.05, 0.2 * place[2]))
    poses, _ = Proposals(NumbaRenderer(), CUP, region).propose(edges, 12)
    aside, along, turn = distances(poses, truth, CUP.axis)
    assert ((aside < 0.005) & (along < 0.06 * place[2]) & (turn < np.deg2rad(15))).any()


def test_normals_are_those_of_the_outline_in_the_image(context):
    ball = model_of(trimesh.creation.icosphere(3, 0.05), [0, 0, 1])
    fx, fy = 600, 300
    turns = 2 * np.pi * np.arange(72) / 72
    offsets, directions = Templates.from_views(NumbaRenderer(), ball, 0.4).turned(
        turns, Pinhole(237, 213, fx, fy, 120.5, 103.0))
    # The outline is an ellipse; its normal is the gradient of (x / fx)^2 + (y / fy)^2.
    size = np.linalg.norm(offsets / [fx, fy], axis=-1)
    np.testing.assert_allclose(size, 0.05 / np.sqrt(0.4 ** 2 - 0.05 ** 2), rtol=0.02)
    normal = np.arctan2(offsets[..., 1] / fy ** 2, offsets[..., 0] / fx ** 2)
    off = directions * 2 * np.pi / 32 - normal
    off = np.abs(np.arctan2(np.sin(off), np.cos(off)))
    # Directions are rounded to a 32nd of a turn: off by a quarter of that in the mean.
    assert off.mean() < 1.5 * np.pi / 64
    assert off.max() < 0.3


def test_no_edges_still_give_proposals_in_the_region(context):
    camera = Pinhole(121, 83, 300, 300, 60, 41)
    edges = EdgeVolume(Header(), np.zeros((83, 121, 5, 3), np.float32),
                       depth_labels(0.3, 0.6, 5), camera)
    poses, scores = Proposals(NumbaRenderer(), CUP, REGION).propose(edges, 7)
    assert len(poses) == 7
    np.testing.assert_array_equal(scores, 0)
    assert REGION.contains(poses[:, :3, 3]).all()


@pytest.mark.parametrize(('width', 'height'), [(121, 83), (3, 2), (4, 90), (1, 1)])
def test_images_of_any_size_are_searched(context, width, height):
    camera = Pinhole(width, height, 300, 300, width / 2, height / 2)
    tensor = np.random.default_rng(0).random((height, width, 3, 3)).astype(np.float32)
    edges = EdgeVolume(Header(), tensor, depth_labels(0.3, 0.6, 3), camera)
    poses, _ = Proposals(NumbaRenderer(), CUP, REGION).propose(edges, 3)
    assert 1 <= len(poses) <= 3
    assert np.isfinite(poses).all()


def test_a_region_far_larger_than_the_view_is_searched_where_it_is_seen(context):
    truth = random_poses(1, 2, depth=(0.38, 0.42))[0]
    edges = scene(context, CUP, truth)
    region = Region((0, 0, 0.4), (10, 10, 0.1))
    poses, _ = Proposals(NumbaRenderer(), CUP, region).propose(edges, 12)
    aside, along, turn = distances(poses, truth, CUP.axis)
    assert ((aside < 0.005) & (along < 0.015) & (turn < np.deg2rad(20))).any()
    seen = CAMERA.project(poses[:, :3, 3])
    assert (np.abs(seen - [CAMERA.cx, CAMERA.cy]) < 400).all()


def test_a_region_out_of_view_is_refused(context):
    edges = scene(context, CUP, random_poses(1, 0)[0])
    region = Region((3, 0, 0.4), (0.1, 0.1, 0.1))
    with pytest.raises(LocalizationError, match='outside the image'):
        Proposals(NumbaRenderer(), CUP, region).propose(edges, 5)


def test_a_sheet_without_thickness_has_no_outline_edge_on(context):
    # A coaster: one of its tilts shows nothing at all.
    disc = trimesh.creation.revolve([(0, 0), (0.05, 0)], sections=32)
    model = replace(model_of(disc, [0, 0, 1]), closed=False)
    truth = random_poses(1, 4, depth=(0.36, 0.44))[0]
    poses, _ = Proposals(NumbaRenderer(), model, REGION).propose(scene(context, model, truth), 12)
    aside, along, turn = distances(poses, truth, model.axis)
    turn = np.minimum(turn, np.pi - turn)  # both of its sides look alike
    assert ((aside < 0.005) & (along < 0.02) & (turn < np.deg2rad(25))).any()


@pytest.mark.parametrize('model', [CUP, BRACKET], ids=['cup', 'bracket'])
def test_no_pose_is_missed_by_its_bound(context, model, monkeypatch):
    """All pairs tried at once: nothing is left out, and the same poses are proposed."""
    edges = scene(context, model, random_poses(1, 3, depth=(0.34, 0.46))[0])
    region = Region((0, 0, 0.4), (0.06, 0.06, 0.06))
    proposals = Proposals(NumbaRenderer(), model, region)
    poses, scores = proposals.propose(edges, 20)
    monkeypatch.setattr(template_matching, 'AT_ONCE', 10 ** 9)
    every, best = proposals.propose(edges, 20)
    np.testing.assert_array_equal(scores, best)
    np.testing.assert_array_equal(poses, every)
