"""Groups of rigid motions: made whole, checked; what they do to poses, proposals and errors."""

import logging
from dataclasses import replace

import numpy as np
import pytest
import trimesh
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import CAMERA, bracket, depth_of, edges_seen, model_of, random_poses
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.surface_errors import Surface
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.se3 import retract, rotation_angle, rotations_about
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.modes import ambiguous_poses
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.proposals.template_matching import Proposals
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import ObjectModelError, SettingsError

DEPTHS = depth_labels(0.3, 0.7, 20)
HALF_X, HALF_Y, HALF_Z = (np.diag([*signs, 1.0]) for signs in ((1, -1, -1), (-1, 1, -1),
                                                              (-1, -1, 1)))


def about(turn, centre=(0, 0, 0)):
    """A turn (rotation vector) about an axis through a point."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    motion[:3, 3] = centre - motion[:3, :3] @ centre
    return motion


def shifted(z, motion=None):
    result = np.eye(4) if motion is None else motion.copy()
    result[2, 3] += z
    return result


def loaded(folder, mesh, **fields):
    mesh.export(folder / 'thing.ply')
    path = folder / 'thing.yaml'
    path.write_text(yaml.safe_dump({'mesh': 'thing.ply'} | fields))
    return ObjectModel.load(path)


def numbers(*motions):
    return [each.ravel().tolist() for each in motions]


def box_model():
    box = trimesh.creation.box((0.03, 0.05, 0.08)).subdivide()
    return replace(model_of(box), discrete=np.stack([np.eye(4), HALF_X, HALF_Y, HALF_Z]))


def rod_model():
    rod = trimesh.creation.cylinder(0.02, 0.09, sections=32)
    return replace(model_of(rod, [0, 0, 1]), discrete=np.stack([np.eye(4), HALF_X]))


BOX, ROD = box_model(), rod_model()
# A box whose origin is the middle of its floor: turned upside down, the origin is up.
STANDING = replace(BOX, vertices=BOX.vertices + np.array([0, 0, 0.04]), discrete=np.stack(
    [np.eye(4), about([0, 0, np.pi]), about([np.pi, 0, 0], [0, 0, 0.04]),
     about([0, np.pi, 0], [0, 0, 0.04])]))
MODELS = {'box': BOX, 'rod': ROD, 'standing': STANDING}


@pytest.mark.parametrize(('given_', 'count'), [
    ([], 1), ([np.eye(4)], 1), ([HALF_X], 2), ([HALF_X, HALF_Y], 4),
    ([about([0, 0, np.pi / 2]), HALF_X], 8),  # of a square prism
    ([about([0, 0, np.pi / 3])], 6),
    ([about(np.full(3, 2 * np.pi / 27 ** 0.5)), about([0, 0, np.pi / 2])], 24)],  # of a cube
    ids=['none', 'identity', 'half turn', 'box', 'prism', 'hexagonal', 'cube'])
def test_the_group_is_made_whole(tmp_path, given_, count):
    model = loaded(tmp_path, bracket(), symmetries_discrete=numbers(*given_))
    group = model.discrete
    assert len(group) == count
    np.testing.assert_array_equal(group[0], np.eye(4))
    for product in (group[:, None] @ group).reshape(-1, 4, 4):
        assert np.abs(group - product).max(axis=(1, 2)).min() < 1e-9


def test_rounded_matrices_generate_the_same_group(tmp_path):
    exact = [about([0, 0, np.pi / 3], [0.01, 0, 0]), about([np.pi, 0, 0])]
    rounded = [np.round(each, 4) for each in exact]
    assert len(loaded(tmp_path, bracket(), symmetries_discrete=numbers(*rounded)).discrete) == 12


def test_translations_are_in_units_of_the_mesh(tmp_path, caplog):
    box = trimesh.creation.box((30, 50, 80)).apply_translation([0, 0, 40])
    flip = about([np.pi, 0, 0], [0, 0, 40])
    with caplog.at_level(logging.WARNING):
        model = loaded(tmp_path, box, scale=0.001, symmetries_discrete=numbers(flip))
    np.testing.assert_allclose(model.discrete[1], about([np.pi, 0, 0], [0, 0, 0.04]), atol=1e-12)
    assert not caplog.records
    with pytest.raises(ObjectModelError, match=r'shifts its origin by 80 m.*units of the mesh'):
        loaded(tmp_path, box.apply_scale(0.001), symmetries_discrete=numbers(flip))


def test_a_group_that_moves_the_surface_is_told(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        loaded(tmp_path, bracket(), symmetries_discrete=numbers(HALF_X))
    assert 'move its surface by up to' in caplog.text


@pytest.mark.parametrize(('motion', 'message'), [
    (np.diag([1.0, 1, -1, 1]), 'not mirrored'),
    (np.diag([2.0, 1, 1, 1]), 'orthonormal within 0.001'),
    (np.diag([1.0, 1, 1, 2]), 'last row 0 0 0 1'),
    (about([0, 0, 1.0]), 'no group of at most 128 rotations'),
    (shifted(0.03, about([0, 0, np.pi])), 'one after the other'),
    (shifted(0.03), 'one after the other')], ids=[
        'mirror', 'scale', 'last row', 'endless', 'screw', 'shift'])
def test_what_is_no_symmetry_is_refused(tmp_path, motion, message):
    with pytest.raises(ObjectModelError, match=message):
        loaded(tmp_path, bracket(), symmetries_discrete=numbers(motion))


@pytest.mark.parametrize(('value', 'message'), [
    ([[1.0] * 15], 'symmetries_discrete.0: .*at least 16'),
    ([[float('nan')] * 16], 'symmetries_discrete.0.0: .*finite'), ([1.0], 'symmetries_discrete.0'),
], ids=['15', 'nan', 'flat'])
def test_matrices_of_another_form_are_refused_by_name(tmp_path, value, message):
    with pytest.raises(SettingsError, match=message):
        loaded(tmp_path, bracket(), symmetries_discrete=value)


def test_beside_an_axis_only_turning_it_round_is_left(tmp_path):
    rod = trimesh.creation.cylinder(0.02, 0.09)
    many = [about([0, 0, 1.0]), about([np.pi, 0, 0]), about([0, np.pi, 0])]
    model = loaded(tmp_path, rod, symmetries_discrete=numbers(*many))
    np.testing.assert_array_equal(model.axis, [0, 0, 1])
    assert len(model.discrete) == 2
    np.testing.assert_allclose(model.discrete[1, :3, :3] @ model.axis, [0, 0, -1], atol=1e-12)
    for wrong, message in ((about([np.pi / 2, 0, 0]), 'can only reverse that axis'),
                           (about([np.pi, 0, 0], [0, 0.01, 0]), 'can only reverse that axis'),
                           (shifted(0.03), 'one after the other')):
        with pytest.raises(ObjectModelError, match=message):
            loaded(tmp_path, rod, symmetries_discrete=numbers(wrong))


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(sorted(MODELS)), st.integers(0, 2 ** 20), st.integers(0, 3),
       st.floats(0, 6))
def test_errors_and_credible_levels_are_those_of_any_pose_alike(name, seed, which, angle):
    model = MODELS[name]
    truth, pose = random_poses(2, seed)
    surface = Surface.from_model(model)
    spin = about(angle * np.array([0, 0, 1.0])) if model.axis is not None else np.eye(4)
    alike = pose @ model.discrete[which % len(model.discrete)] @ spin
    errors, others = (pose_error(each, truth, model.symmetry)
                      for each in (pose, alike))
    assert errors.rotation == pytest.approx(others.rotation, abs=1e-6)
    assert errors.rotation <= (np.pi / 2 if model.axis is not None else 2 * np.pi / 3) + 1e-9
    assert surface.mssd(alike, truth) == pytest.approx(surface.mssd(pose, truth), abs=1e-4)
    assert surface.mssd(alike, pose) < 1e-4
    spread = np.diag([1e-4, 2e-4, 3e-4, 0.1, 0.2, 0.3])
    levels = [model.symmetry.credible_level(each, truth, spread) for each in (pose, alike)]
    if name != 'standing':  # of poses equally near the origin may be another
        assert levels[0] == pytest.approx(levels[1], abs=1e-6)
    nearest = model.symmetry.nearest_equivalents(alike[None], pose)[0]
    assert nearest[:, 3] == pytest.approx(pose[:, 3], abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(sorted(MODELS)), st.integers(0, 2 ** 20))
def test_folding_turns_least_and_the_canonical_pose_is_one_for_all(name, seed):
    model = MODELS[name]
    symmetry, spins = model.symmetry, Symmetry(model.axis)
    reference, *poses = random_poses(9, seed)
    poses = np.stack(poses)
    folded = symmetry.nearest_equivalents(poses, reference)
    angles = symmetry.rotation_distance(folded, reference)
    for motion in model.discrete:
        other = symmetry.nearest_equivalents(poses @ motion, reference)
        np.testing.assert_allclose(symmetry.rotation_distance(other, reference), angles,
                                   atol=1e-6)
        assert (angles <= spins.rotation_distance(poses @ motion, reference) + 1e-9).all()
    for pose in poses:
        found = [symmetry.canonical(symmetry.equivalents(each))
                 for each in symmetry.equivalents(pose)]
        np.testing.assert_allclose(found, np.tile(found[0], (len(found), 1, 1)), atol=1e-7)
        assert Surface.from_model(model).mssd(found[0], pose) < 2e-5


@pytest.mark.parametrize('name', sorted(MODELS))
@pytest.mark.parametrize('seed', range(4))
def test_a_symmetry_is_not_ambiguous(name, seed):
    model = MODELS[name]
    pose = random_poses(1, seed)[0]
    plain = ambiguous_poses(replace(model, discrete=np.eye(4)[None]), pose)
    found = ambiguous_poses(model, pose)
    assert len(found) < len(plain)
    assert not model.symmetry.same_mode(found, pose, 0.01, 0.1).any()
    for each in plain:  # whatever was left out is the pose, or one that was kept
        known = np.concatenate([pose[None], found])
        assert any(model.symmetry.same_mode(each[None], other, 0.011, 0.16)[0]
                   for other in known)


@pytest.mark.parametrize(('name', 'share'), [('box', 0.45), ('rod', 0.55), ('standing', 0.7)])
def test_no_orientation_is_proposed_twice(name, share):
    model = MODELS[name]
    region = Region((0, 0, 0.4), (0.1, 0.1, 0.16))
    plain, found = (Proposals(NumbaRenderer(), each, region).templates.rotations for each in
                    (replace(model, discrete=np.eye(4)[None]), model))
    assert len(found) < share * len(plain)
    # Every side is still seen, as near to a template as without the symmetry, or nearly.
    turns = model.symmetry.rotations_in_place
    sides = plain[:, 2] @ turns  # rows: lines of sight in the object's frame
    if model.axis is not None:
        cosines = (sides @ model.axis)[..., None] - (found[:, 2] @ model.axis)
        assert np.abs(cosines).min(axis=(0, 2)).max() < 1e-9
    else:
        nearest = (sides @ found[:, 2].T).max(axis=(0, 2))
        assert np.rad2deg(np.arccos(nearest.min())) < 8


SETTINGS = PmclSettings(roi_center=(0, 0, 0.39), roi_size=(0.1, 0.1, 0.1), renderer='numba',
                        proposals=24, particles=96)


@pytest.mark.parametrize('name', sorted(MODELS))
def test_an_object_is_found_whichever_of_its_poses_is_the_truth(context, name):
    model = MODELS[name]
    truth = random_poses(1, 3, depth=(0.36, 0.42))[0]
    depth = depth_of(context, model, truth, CAMERA, 4)
    edges = edges_seen(depth, CAMERA, DEPTHS, 0.2 * model.radius, strength=2.0)
    tensor = edges.tensor + np.array([0.05, 0.05, 0], np.float32)
    with Localizer(model, SETTINGS) as localizer:
        estimates = [localizer.localize(replace(edges, tensor=tensor),
                                        np.random.default_rng(seed)) for seed in (0, 1)]
    for estimate in estimates:
        assert not estimate.lost
        for alike in model.symmetry.equivalents(truth):
            error = pose_error(estimate.pose, alike, model.symmetry)
            assert error.translation < 0.006
            assert error.rotation < np.deg2rad(8)
        # One mode has them all: nothing is left of the poses alike.
        assert estimate.modes[0].weight > 0.95
        near = Symmetry(model.axis).rotation_distance(estimate.particles, estimate.pose)
        assert np.quantile(near, 0.9) < 0.3
        assert np.sqrt(np.diag(estimate.covariance)[:3]).max() < 0.01
    first, second = estimates
    assert Symmetry(model.axis).rotation_distance(first.pose[None], second.pose)[0] < 0.15


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(sorted(MODELS)), st.integers(0, 2 ** 20))
def test_the_nearest_is_nearer_than_every_other_that_looks_alike(name, seed):
    model = MODELS[name]
    symmetry = model.symmetry
    reference, pose = random_poses(2, seed)
    found = symmetry.nearest(symmetry.equivalents(pose), reference)
    assert Surface.from_model(model).mssd(found, pose) < 2e-5
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    spins = [np.eye(4)] if model.axis is None else rotations_about(model.axis, angles)
    alike = np.concatenate([symmetry.equivalents(pose) @ each for each in spins])
    least = rotation_angle(found[None], reference)[0]
    assert least <= rotation_angle(alike, reference).min() + 1e-6
    # Whichever of them was found by the search, the same one is chosen.
    for each in alike[::97]:
        again = symmetry.nearest(symmetry.equivalents(each), reference)
        np.testing.assert_allclose(again, found, atol=1e-6)
    for each in alike[::97]:
        np.testing.assert_allclose(symmetry.nearest(symmetry.equivalents(pose), each)[:3, :3],
                                   each[:3, :3], atol=1e-6)


@pytest.mark.parametrize('axis', np.eye(3))
def test_a_reversed_axis_is_half_a_turn_away(axis):
    rod = Symmetry(axis)
    poses = np.array([about([0.3, -0.2, 0.9]), about([0, 0, 0.0]), about([-2.0, 1.0, 0.4])])
    across = Rotation.from_rotvec(np.pi * np.roll(axis, 1)).as_matrix()
    turned = poses.copy()
    turned[:, :3, :3] = poses[:, :3, :3] @ across
    for mean, found in ((poses, rod.local(turned, poses)),
                        (poses[0], rod.local(turned[:1], poses[0]))):
        assert np.linalg.norm(found[:, 3:], axis=1) == pytest.approx(np.pi)
        back = retract(np.array(mean).reshape(-1, 4, 4)[:len(found)], found)
        np.testing.assert_allclose(back[:, :3, :3] @ axis, turned[:len(found), :3, :3] @ axis,
                                   atol=1e-9)
    assert rod.credible_level(turned[0], poses[0], np.eye(6) * 1e-4) == pytest.approx(1)


def test_of_a_reversed_axis_any_spin_is_as_near():
    rod = Symmetry(np.array([0, 0, 1.0]))
    pose = about([0.3, -0.2, 0.9])
    assert rod.nearest_spin(pose, pose @ HALF_X) is pose
