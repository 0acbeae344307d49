"""The search in contour maps: the score's definition, and known poses."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from contour_maps import NUMBERS, map_seen
from pmcl_scenes import CAMERA, bracket, cup, model_of, pose_of
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.learned import NO_SLOPES, SupportSlopes, learned_map_evidence
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.learning.contour_errors import Deviation, fitted_offset
from pmcl_ros.learning.contour_tables import Example
from pmcl_ros.learning.searches import found
from pmcl_ros.pmcl.contour_approximations import LinearizedContour
from pmcl_ros.pmcl.contour_evidence import ContourEvidence
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.support import contour_support, log_odds, share_in_view
from pmcl_ros.pmcl.view_terms import ViewContour
from pmcl_ros.runtime import kernel_threads
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_view
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene

NEAR, FAR = 0.3, 0.6
ZOOM = 4
WHOLE = Window(0, 0, (CAMERA.width, CAMERA.height))


def seen(model, pose, camera=CAMERA):
    """The contour map of an object alone."""
    return map_seen(depth_of(model, pose, camera) > 0, camera, NEAR, FAR, ZOOM)


def depth_of(model, pose, camera=CAMERA):
    """(ZOOM * height, ZOOM * width) depths of an object [m], 0 elsewhere."""
    finer = Pinhole(camera.width * ZOOM, camera.height * ZOOM, camera.fx * ZOOM,
                    camera.fy * ZOOM, camera.cx * ZOOM + 1.5, camera.cy * ZOOM + 1.5)
    scene = Scene(model, finer, Window(0, 0, (finer.width, finer.height)), NEAR, FAR)
    return NumbaRenderer().depths(scene, pose[None])[0]


CUP, BRACKET = model_of(cup(), axis=(0, 0, 1)), model_of(bracket())
CUP_POSE = pose_of(Rotation.from_euler('xyz', [1.9, 0.3, 0.2]), [0.01, -0.005, 0.45])
BRACKET_POSE = pose_of(Rotation.from_euler('xyz', [2.2, 0.5, 0.8]), [-0.01, 0.008, 0.42])
# A search that is soon done, of a small region about the cup.
SMALL = PmclSettings(roi_center=tuple(CUP_POSE[:3, 3]), roi_size=(0.06, 0.06, 0.06),
                     renderer='numba', proposals=8, particles=32, moves=1)
NARROW = OrdinaryCamera(width=320, height=240, fx=600, cx=159.5, cy=119.5)


@pytest.mark.parametrize(('model', 'pose'), [(CUP, CUP_POSE), (BRACKET, BRACKET_POSE)],
                         ids=['cup', 'bracket'])
def test_a_known_pose_is_found(model, pose):
    middle = pose[:3, 3] + [0.012, -0.01, 0.015]
    settings = PmclSettings(roi_center=tuple(middle), roi_size=(0.12, 0.12, 0.14),
                            renderer='numba')
    with Localizer(model, settings) as localizer:
        found = localizer.localize(seen(model, pose), np.random.default_rng(0))
    error = pose_error(found.pose, pose, model.symmetry)
    assert not found.lost
    assert error.translation < 0.004
    assert error.rotation < np.deg2rad(3)


def test_the_same_seed_gives_the_identical_pose_in_any_localizer_by_any_threads(all_threads):
    odds = seen(CUP, CUP_POSE)

    def localized(localizer, seed=5):
        return localizer.localize(odds, np.random.default_rng(seed))

    with Localizer(CUP, SMALL) as localizer:
        other = localized(localizer, 6)
        expected = localized(localizer)
    assert (other.particles != expected.particles).any()
    for number in sorted({1, min(2, all_threads), all_threads}):
        kernel_threads.set_threads(number)
        with Localizer(CUP, SMALL) as localizer:
            again = localized(localizer)
        for name in ('pose', 'covariance', 'particles', 'log_weights', 'score', 'support'):
            np.testing.assert_array_equal(getattr(again, name), getattr(expected, name))


def test_a_part_out_of_view_counts_as_no_evidence():
    """Else what little is in view would show the object."""
    pose = CUP_POSE.copy()
    while share_in_view(CUP, pose, CAMERA) > 0.75:
        pose[0, 3] -= 0.004
    odds, settings = seen(CUP, pose), SMALL.model_copy(update={'roi_center': tuple(pose[:3, 3])})
    with Localizer(CUP, settings) as localizer:
        estimate = localizer.localize(odds, np.random.default_rng(0))
        there, = localizer.observe(odds, [estimate.pose])
    assert pose_error(estimate.pose, pose, CUP.symmetry).translation < 0.01
    assert estimate.in_view == there.in_view < 0.9
    assert estimate.support == pytest.approx(contour_support(there.points, there.in_view))
    assert estimate.support < contour_support(there.points, 1.0)


@pytest.mark.parametrize('aside', [0.0, 0.06, 0.08, 0.1])
def test_out_of_view_is_no_way_out_of_a_picture_that_shows_nothing(aside):
    """Each contour in plain view has evidence against it, and none where nothing is in view."""
    nothing = replace(map_seen(np.zeros((ZOOM * CAMERA.height, ZOOM * CAMERA.width), bool), CAMERA,
                               NEAR, FAR, ZOOM), numbers=learned_map_evidence())
    settings = SMALL.model_copy(update={'roi_center': (aside, 0.0, 0.45)})
    with Localizer(CUP, settings) as localizer:
        estimate = localizer.localize(nothing, np.random.default_rng(0))
    assert estimate.lost
    assert estimate.support <= 0


def inexact(target):
    """Meshes of a vessel with a handle, by what is wrong; each has a lid, which the vessel lacks.
    """
    mesh = trimesh.Trimesh(target.vertices, target.faces, process=False)
    body = max(mesh.split(), key=lambda each: each.volume)
    wider = mesh.vertices + 0.0005 * mesh.vertex_normals  # on each side
    return {'lid': target.model('lid'), 'no handle': model_of(body, (0, 0, 1)),
            '1 mm wider': replace(target.model('wider'), vertices=wider)}


@pytest.mark.parametrize(('kind', 'seed'), [('glass handle', 6), ('opaque handle', 5)])
def test_a_mesh_that_is_not_exact_gives_a_pose_near_by_or_none(kind, seed):
    """In one picture an object that is a hundredth wider is a hundredth farther, too."""
    rng = np.random.default_rng(seed)
    of = SceneSettings(kinds=(kind,), empty=0, outside=0, clutter=0, field=NARROW.field)
    scene = random_scene(rng, of, sensor=NARROW.sensor(rng))
    odds = build_map(take_view(scene, NARROW, np.eye(4), rng, 2), DlvSettings(near=0.3, far=0.9))
    target, = scene.targets
    settings = PmclSettings(roi_center=target.roi_center, roi_size=target.roi_size,
                            renderer='numba', particles=64, moves=1)
    claimed = {}
    for what, model in inexact(target).items():
        with Localizer(model, settings) as localizer:
            found = localizer.localize(odds, np.random.default_rng(0))
        if not found.lost:
            claimed[what] = pose_error(found.pose, target.pose, model.symmetry)
            assert claimed[what].translation < 0.012
            assert claimed[what].rotation < np.deg2rad(6)
    assert claimed['lid'].translation < 0.004


def test_contours_that_are_found_inside_are_looked_for_there():
    mask = (depth_of(CUP, CUP_POSE) > 0).astype(np.uint8)
    inside = cv2.erode(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))) > 0
    odds = map_seen(inside, CAMERA, NEAR, FAR, ZOOM)  # half a pixel inside
    region = Region(tuple(CUP_POSE[:3, 3]), (0.06, 0.06, 0.1))
    off, told = [], []
    for offset in (0.0, -0.5):
        numbers = NUMBERS.model_copy(update={'inside_weight': 0.0, 'contour_offset': offset})
        example = Example(replace(odds, numbers=numbers), CUP, CUP_POSE, region)
        estimate = found(example, CUP, None, 0)
        off.append(estimate.pose[2, 3] - CUP_POSE[2, 3])
        told.append(fitted_offset([Deviation.from_estimate(
            example, estimate, example.volume.profile, NumbaRenderer())]))
    # A contour of the half size r px that is half a pixel smaller is farther by 0.5 / r.
    assert off[0] > 0.002
    assert abs(off[1]) < 0.001
    assert told[0] == pytest.approx(-0.5, abs=0.1)
    assert told[1] == pytest.approx(0, abs=0.1)


def test_a_score_is_that_of_its_contour_and_of_the_pixels_it_covers():
    odds, scene = seen(BRACKET, BRACKET_POSE), Scene(BRACKET, CAMERA, WHOLE, NEAR, FAR)
    for inside in (odds.inside, np.zeros_like(odds.inside)):
        odds = replace(odds, inside=inside)
        with NumbaRenderer().contour_score(scene, odds, odds.profile) as score:
            value = score(BRACKET_POSE[None])[0]
            points = score.points(BRACKET_POSE)
        covered = NumbaRenderer().depths(scene, BRACKET_POSE[None])[0] > 0
        expected = NUMBERS.inside_weight * inside[..., 0][covered].sum()
        assert points.covered == pytest.approx(expected, rel=1e-4)
        assert value == pytest.approx(points.lengths @ points.evidence + points.covered, rel=1e-4)
    assert points.covered == 0


def test_covered_pixels_count_near_a_pose_as_at_it():
    """To first order, a silhouette that moves outwards gains what it covers."""
    odds = seen(CUP, CUP_POSE)
    only = replace(odds, tensor=np.zeros_like(odds.tensor),
                   inside=np.ones_like(odds.inside))
    scene = Scene(CUP, CAMERA, WHOLE, NEAR, FAR)
    with NumbaRenderer().contour_score(scene, only, only.profile) as score:
        local = LinearizedContour.from_view(
            CUP_POSE, ViewContour(score.points(CUP_POSE), only, only.profile))
        nearer = np.array([[0, 0, -0.005, 0, 0, 0], [0, 0, 0.005, 0, 0, 0.0]])
        exact = score(retract(CUP_POSE, nearer))
        assert local.evidence(np.zeros((1, 6)))[0] == pytest.approx(score(CUP_POSE[None])[0],
                                                                    rel=1e-6)
    assert exact[0] > exact[1]
    assert np.ptp(local.evidence(nearer)) == pytest.approx(np.ptp(exact), rel=0.1)


def test_the_mean_inside_is_that_of_what_the_object_covers():
    odds = seen(CUP, CUP_POSE)
    values = np.random.default_rng(0).normal(1, 1, (*odds.inside.shape[:2], 3))
    odds = replace(odds, depths=depth_labels(NEAR, FAR, 3), inside=values.astype(np.float32),
                   tensor=np.repeat(odds.tensor, 3, axis=2),
                   numbers=NUMBERS.model_copy(update={'inside_weight': 1.0}))
    evidence = ContourEvidence.from_volume(odds, NumbaRenderer(), CUP, SMALL, None, None, None)
    with evidence.score() as score:
        points, posterior = score.points(CUP_POSE), evidence.posterior(score)
    drawn = NumbaRenderer().depths(Scene(CUP, CAMERA, WHOLE, NEAR, FAR), CUP_POSE[None])[0]
    covered = np.count_nonzero(drawn)  # about the depth of the middle label
    assert posterior.inside_at(CUP_POSE) == pytest.approx(points.covered / covered, abs=0.02)
    assert posterior.inside_at(CUP_POSE) == pytest.approx(values[drawn > 0, 1].mean(), abs=1e-5)
    edges = EdgeVolume(odds.header, odds.tensor[..., :3], odds.depths, CAMERA)
    assert np.isnan(replace(evidence, volume=edges).inside(CUP_POSE))
    behind = CUP_POSE.copy()
    behind[2, 3] *= -1
    assert evidence.inside(behind) == 0


def test_evidence_weight_and_inside_change_the_support_that_is_needed():
    odds = seen(CUP, CUP_POSE)

    def localized(least, slopes, settings=SMALL):
        numbers = NUMBERS.model_copy(update={
            'least_support': least, 'evidence_slope': slopes.evidence,
            'odds_slope': slopes.odds, 'inside_slope': slopes.inside})
        with Localizer(CUP, settings) as localizer:
            return localizer.localize(replace(odds, numbers=numbers), np.random.default_rng(0))

    free, slopes = localized(-1.0, NO_SLOPES), SupportSlopes(0.5, 0.25, 0.125)
    margin = (free.support + 0.5 * free.evidence + 0.25 * log_odds(free.modes[0].weight)
              - 0.125 * free.inside)
    assert 0.5 < free.inside <= 1
    assert free.diagnostics()['inside'] == free.as_dict()['inside'] == free.inside
    for lacking, lost in ((-0.01, False), (0.01, True)):
        found = localized(margin + lacking, slopes)
        assert found.lost is lost
        assert found.support == free.support
        assert found.least_support == pytest.approx(free.support + lacking)
        assert found.diagnostics()['least support'] == found.least_support
        # What is chosen holds for all poses.
        chosen = SMALL.model_copy(update={'least_support': free.support - 0.01})
        found = localized(margin + lacking, slopes, chosen)
        assert not found.lost
        assert found.least_support == chosen.least_support


def test_a_pose_that_is_as_likely_as_another_is_lost():
    """The right half of a picture and its mirror image: a cup's mirrored pose is one of it."""
    camera = replace(CAMERA, cx=(CAMERA.width - 1) / 2)
    pose = pose_of(Rotation.from_euler('xyz', [1.9, 0.3, 0.2]), [0.04, -0.005, 0.45])
    one = seen(CUP, pose, camera)
    mirrored = one.tensor[:, ::-1] * np.array([1, -1, 1, 1, -1], np.float32)
    right = np.arange(camera.width) > camera.cx
    both = np.where(right[:, None, None], one.tensor, mirrored)
    settings = PmclSettings(roi_center=(0.0, -0.005, 0.45), roi_size=(0.12, 0.06, 0.1),
                            renderer='numba', proposals=100)
    for least, tensor, lost in ((0.9, both, True), (0.0, both, False), (0.9, one.tensor, False)):
        odds = replace(one, tensor=np.ascontiguousarray(tensor), numbers=NUMBERS.model_copy(
            update={'least_weight': least, 'inside_weight': 0.0, 'odds_slope': 0.5,
                    'least_support': 1.0 if lost else NUMBERS.least_support}))
        with Localizer(CUP, settings) as localizer:
            found = localizer.localize(odds, np.random.default_rng(0))
        assert found.lost is lost, found.modes
        assert ('other poses are as likely' in found.describe()) is lost
