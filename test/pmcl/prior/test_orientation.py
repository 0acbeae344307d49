"""The prior of an object's orientation: its set of rotations, and searches within it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import CAMERA, COARSE, bracket, cup, depth_of, edges_seen, model_of, random_poses
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.posed_evidence import PosedEvidence, ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.particle_filter import particle_filter
from pmcl_ros.pmcl.prior.orientation import Orientation
from pmcl_ros.pmcl.prior.region import Region, with_region
from pmcl_ros.pmcl.proposals.template_matching import Proposals
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import SettingsError

DEPTHS = depth_labels(0.3, 0.7, 20)
CUP = model_of(cup(), [0, 0, 1])
BRACKET = model_of(bracket())
UP = np.array([0.2, -0.9, 0.3])
FLIP = np.diag([1.0, -1, -1, 1])
REGION = Region((0, 0, 0.4), (0.1, 0.1, 0.16))
QUICK = {'proposals': 100, 'particles': 64, 'moves': 1}  # of a search
AWAY = np.array([0, -1.0, 0])  # upright in a picture


def given_by(tilt, up=UP, model=BRACKET, **changes):
    settings = PmclSettings(roi_up=tuple(up), roi_tilt=tilt, roi_center=REGION.center,
                            roi_size=REGION.size, **changes)
    return settings, Orientation.from_settings(settings, model)


def tilts(rotations, up=UP, axis=(0, 0, 1)):
    """(n,) angle between an axis of the object and a direction [rad]."""
    axes = rotations @ np.array(axis, float)
    return np.arccos(np.clip(axes @ up / np.linalg.norm(up), -1, 1))


def turned_by(ends, starts):
    """(n,) angle between rotations [rad]."""
    return (Rotation.from_matrix(ends) * Rotation.from_matrix(starts).inv()).magnitude()


bounds = st.tuples(st.floats(0, np.pi), st.floats(0, np.pi)).map(sorted).filter(
    lambda pair: pair != [0.0, np.pi])


@given(bounds, st.integers(0, 1000), st.sampled_from([UP, np.array([1.0, 0, 0])]))
def test_what_is_not_possible_is_turned_as_little_as_makes_it_so(tilt, seed, up):
    _, orientation = given_by(tuple(tilt), up)
    rotations = Rotation.random(50, seed).as_matrix()
    rotations[0] = Rotation.align_vectors([up], [[0, 0, 1]])[0].as_matrix()  # along, and against
    rotations[1] = rotations[0] @ FLIP[:3, :3]
    clipped = orientation.clip(rotations)
    angles = tilts(rotations, up)
    for slack in (0, 0.2):
        np.testing.assert_array_equal(
            orientation.allows(rotations, slack),
            (angles >= tilt[0] - slack - 1e-7) & (angles <= tilt[1] + slack + 1e-7))
    assert orientation.allows(clipped, 1e-6).all()
    np.testing.assert_allclose(turned_by(clipped, rotations),
                               np.abs(np.clip(angles, *tilt) - angles), atol=2e-6)


@settings(max_examples=30)
@given(bounds.filter(lambda pair: pair[1] - pair[0] > 0.01))
def test_rotations_are_drawn_uniformly_from_those_that_are_possible(tilt):
    _, orientation = given_by(tuple(tilt))
    drawn = orientation.draw(2000, np.random.default_rng(3))
    assert orientation.allows(drawn, 1e-7).all()
    # Uniform over SO(3): the cosine is, and so are heading and spin.
    low, high = np.cos(tilt[1]), np.cos(tilt[0])
    assert kstest((np.cos(tilts(drawn)) - low) / (high - low), 'uniform').pvalue > 1e-4
    across = np.cross(UP, [1.0, 0, 0])
    frame = np.stack([across, np.cross(UP, across)]) / np.linalg.norm(across)
    for pair in ((drawn[:, :, 2] @ frame.T * [1, 1 / np.linalg.norm(UP)]).T,
                 (UP @ drawn)[:, :2].T):
        heading = np.arctan2(*pair)
        assert kstest(heading / (2 * np.pi) + 0.5, 'uniform').pvalue > 1e-4


def test_another_frame_makes_no_difference():
    _, orientation = given_by((0.3, 1.0))
    camera = np.eye(4)
    camera[:3, :3], camera[:3, 3] = Rotation.random(None, 5).as_matrix(), (1, 2, 3)
    rotations = Rotation.random(200, 6).as_matrix()
    np.testing.assert_array_equal(
        orientation.seen_from(camera).allows(camera[:3, :3].T @ rotations),
        orientation.allows(rotations))


def test_the_angle_is_to_what_is_declared_to_be_up(tmp_path):
    (tmp_path / 'bracket.yaml').write_text(yaml.safe_dump({
        'mesh': 'bracket.stl', 'appearance': {'material': 'glass', 'up': [0, 2, 0]}}))
    trimesh.Trimesh(BRACKET.vertices, BRACKET.faces).export(tmp_path / 'bracket.stl')
    model = ObjectModel.load(tmp_path / 'bracket.yaml')
    _, orientation = given_by((0.1, 0.9), model=model)
    rotations = Rotation.random(300, 8).as_matrix()
    angles = tilts(rotations, axis=(0, 1, 0))
    np.testing.assert_array_equal(orientation.allows(rotations), (angles >= 0.1) & (angles <= 0.9))


def test_the_axis_is_that_of_the_symmetry_and_either_way_where_both_look_the_same():
    # A cup about x, told by a direction that points down its axis.
    turned = Rotation.from_euler('y', 90, degrees=True).as_matrix()
    lying = replace(CUP, vertices=CUP.vertices @ turned.T, axis=turned @ CUP.axis)
    rotations = Rotation.random(300, 7).as_matrix()
    _, upright = given_by((0.0, 0.7), model=CUP)
    _, about_x = given_by((0.0, 0.7), model=lying)
    np.testing.assert_array_equal(about_x.allows(rotations @ turned.T), upright.allows(rotations))
    assert about_x.allows(about_x.draw(100, np.random.default_rng(4)), 1e-7).all()
    against = replace(CUP, axis=-CUP.axis)
    np.testing.assert_array_equal(given_by((0.0, 0.7), model=against)[1].allows(rotations),
                                  upright.allows(rotations))
    both = replace(BRACKET, discrete=np.stack([np.eye(4), FLIP]))
    _, either = given_by((0.0, 0.7), model=both)
    np.testing.assert_array_equal(either.allows(rotations), upright.allows(rotations)
                                  | upright.allows(rotations @ FLIP[:3, :3]))
    clipped = either.clip(rotations)
    assert either.allows(clipped, 1e-6).all()
    assert turned_by(clipped, rotations).max() < np.pi / 2 - 0.7 + 1e-6


@pytest.mark.parametrize(('values', 'message'), [
    ({'roi_tilt': (0.0, 0.5)}, 'is an angle to no direction: set roi_up'),
    ({'roi_up': (0, 0, 1)}, 'allows any orientation: set roi_tilt'),
    ({'roi_up': (0, 0, 1), 'roi_tilt': (0.5, 0.2)}, 'not 0.5 and 0.2'),
    ({'roi_up': (0, 0, 1), 'roi_tilt': (0, 30)}, 'roi_tilt'),  # degrees
])
def test_what_says_nothing_is_refused(values, message):
    with pytest.raises(SettingsError, match=message):
        PmclSettings.make(values, 'test')


def test_upright_on_a_table_needs_no_direction():
    settings = PmclSettings(roi_table=(0, 0.1, 0.4, 0, -2, 0.1), roi_tilt=(0, 0.3))
    camera = Pinhole(200, 150, 300, 260, 101, 73)
    placed = with_region(settings, [(camera, np.eye(4))], 0.05)
    assert placed.roi_up == (0, -2, 0.1)
    assert placed.roi_tilt == (0, 0.3)
    for other, up in (({'roi_up': (0, 0, 1)}, (0, 0, 1)), ({'roi_tilt': (0, np.pi)}, (0, 0, 0))):
        changed = with_region(settings.model_copy(update=other), [(camera, np.eye(4))], 0.05)
        assert changed.roi_up == up
        assert changed.is_oriented == any(up)


@pytest.mark.parametrize('model', [CUP, BRACKET], ids=['cup', 'bracket'])
def test_all_proposals_are_possible_and_one_is_near_the_pose(context, model):
    truth = random_poses(1, 4, depth=(0.34, 0.46))[0]
    edges = edges_seen(depth_of(context, model, truth, COARSE, 4), COARSE, DEPTHS,
                       0.2 * model.radius)
    up = truth[:3, :3] @ Rotation.from_rotvec([0.25, 0, 0]).as_matrix()[:, 2]
    proposals = Proposals(NumbaRenderer(), model, REGION)
    _, orientation = given_by((0.0, 0.3), up, model)
    poses, _ = proposals.propose(edges, 12, orientation)
    assert orientation.allows(poses[:, :3, :3], 1e-6).all()
    off = np.linalg.norm(poses[:, :3, 3] - truth[:3, 3], axis=1)
    turn = model.symmetry.rotation_distance(poses, truth)
    assert ((off < 0.016) & (turn < np.deg2rad(20))).any()
    # Without the prior there are others among them.
    poses, _ = proposals.propose(edges, 200)
    assert not orientation.allows(poses[:, :3, :3]).all()


@pytest.fixture
def two_cups(context):
    """A standing cup, fainter than one that lies, as cameras at some angles see them."""
    standing, lying = np.eye(4), np.eye(4)
    standing[:3, :3] = Rotation.from_euler('xz', [100, 5], degrees=True).as_matrix()
    standing[:3, 3] = -0.02, 0.035, 0.46
    lying[:3, :3] = Rotation.from_euler('xz', [100, 80], degrees=True).as_matrix()
    lying[:3, 3] = -0.03, -0.01, 0.46

    def seen(camera):
        one, other = (edges_seen(depth_of(context, CUP, np.linalg.inv(camera) @ pose, COARSE, 4),
                                 COARSE, DEPTHS, 0.2 * CUP.radius, strength=strength)
                      for pose, strength in ((standing, 1.3), (lying, 2.0)))
        faint = np.array([0.05, 0.05, 0], np.float32)
        return replace(one, tensor=np.maximum(one.tensor, other.tensor) + faint)
    return standing, lying, seen


def error_of(estimate, truth):
    return pose_error(estimate.pose, truth, CUP.symmetry).translation


def test_a_search_finds_the_object_that_is_turned_as_told(two_cups):
    standing, lying, seen = two_cups
    edges = seen(np.eye(4))
    rng = np.random.default_rng
    with Localizer(CUP, given_by((0, np.pi), (0, 0, 0), **QUICK)[0]) as localizer:
        assert error_of(localizer.localize(edges, rng(0)), lying) < 0.005
    settings, orientation = given_by((0, 0.5), AWAY, CUP, **QUICK)
    with Localizer(CUP, settings) as localizer:
        estimate = localizer.localize(edges, rng(0))
    assert error_of(estimate, standing) < 0.005
    for each in estimate.modes:
        assert orientation.allows(each.pose[None, :3, :3], 1e-6).all()
    with Localizer(CUP, given_by((1.1, 2.0), AWAY, CUP, **QUICK)[0]) as localizer:
        assert error_of(localizer.localize(edges, rng(0)), lying) < 0.005


@pytest.mark.parametrize('tilt', [(0.0, 0.5), (2.6, np.pi)], ids=['upright', 'upside down'])
def test_of_equal_poses_the_one_is_told_that_is_turned_as_told(context, tmp_path, tilt):
    """A box, which looks the same upside down, and whose symmetries are found from its mesh."""
    trimesh.creation.box((0.03, 0.05, 0.08)).export(tmp_path / 'box.ply')
    box = ObjectModel.load(tmp_path / 'box.ply')
    assert len(box.discrete) == 4
    truth = np.eye(4)
    truth[:3, :3] = Rotation.from_euler('zx', [30, 105], degrees=True).as_matrix()
    truth[:3, 3] = 0, 0.01, 0.42
    edges = edges_seen(depth_of(context, box, truth, CAMERA, 4), CAMERA, DEPTHS, 0.2 * box.radius,
                       strength=2.0)
    edges = replace(edges, tensor=edges.tensor + np.array([0.05, 0.05, 0], np.float32))
    with Localizer(box, given_by(tilt, AWAY, box, proposals=24, particles=96)[0]) as localizer:
        estimate = localizer.localize(edges, np.random.default_rng(0))
    assert not estimate.lost
    error = pose_error(estimate.pose, truth, box.symmetry)
    assert error.translation < 0.006
    assert error.rotation < np.deg2rad(8)
    assert tilt[0] <= tilts(estimate.pose[None, :3, :3], AWAY) <= tilt[1]


def test_a_search_in_several_views_finds_what_is_turned_as_told(two_cups):
    standing, lying, seen = two_cups
    frame = np.eye(4)  # a base, whose z is up
    frame[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    views = []
    for angle in (-20, 20):
        camera = np.eye(4)
        turn = Rotation.from_euler('y', angle, degrees=True).as_matrix()
        camera[:3, :3], camera[:3, 3] = turn, [0, 0, 0.46] - turn @ [0, 0, 0.46]
        views.append(PosedEvidence(seen(camera), frame @ camera))
    evidence = ViewsEvidence(Header(7, 'base'), tuple(views))
    # Labels of depth follow from the region: the cups are in its middle.
    box = {'roi_center': tuple(frame[:3, :3] @ [0, 0, 0.46]), 'roi_size': (0.1, 0.16, 0.1)}
    for tilt, truth in (((0, 0.5), standing), ((1.1, 2.0), lying)):
        settings = PmclSettings(**box, roi_up=(0, 0, 1), roi_tilt=tilt, **QUICK)
        with MultiViewLocalizer(CUP, settings) as localizer:
            estimate = localizer.localize(evidence, np.random.default_rng(0))
        assert error_of(estimate, frame @ truth) < 0.005
        assert tilt[0] <= tilts(estimate.pose[None, :3, :3], np.array([0, 0, 1.0])) <= tilt[1]


def test_the_papers_filter_starts_with_what_is_possible():
    settings, orientation = given_by((0.2, 0.4), mode='faithful', faithful_particles=200)
    poses, _ = particle_filter(lambda poses: np.full(len(poses), 0.02), REGION, settings,
                               np.random.default_rng(0), lambda _: True, None, orientation)
    assert orientation.allows(poses[:, :3, :3], 1e-7).all()
