"""The local model, against finite motions of a rendered contour."""

import numpy as np
import pytest
from pmcl_scenes import CAMERA, bracket, cup, depth_of, edges_seen, model_of, random_poses
from scipy.spatial import cKDTree

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.energies import energies_across
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.view_terms import ViewContour, normal_motion

DEPTHS = depth_labels(0.3, 0.7, 20)
CUP = model_of(cup(), [0, 0, 1])
BRACKET = model_of(bracket())
PROFILE = ContourProfile.contrast()
ERROR = ModelError(0.1, 0.1, 30)


def seen(model, pose, edges):
    scene = Scene(model, CAMERA, Window(0, 0, (CAMERA.width, CAMERA.height)), 0.25, 0.75)
    return NumbaRenderer().contour_score(scene, edges, PROFILE)


def scene(context, model, seed):
    truth = random_poses(1, seed, depth=(0.4, 0.45), aside=0.01)[0]
    depth = depth_of(context, model, truth, CAMERA, 4)
    return truth, edges_seen(depth, CAMERA, DEPTHS, 0.2 * model.radius)


def about(score, edges, pose, symmetry, error=ERROR):
    view = ViewContour(score.points(pose), edges, PROFILE)
    return LocalModel.from_views(pose, symmetry, [view], error)


@pytest.mark.parametrize('model', [CUP, BRACKET], ids=['cup', 'bracket'])
def test_a_contour_moves_along_its_normals_as_foretold(context, model):
    truth, edges = scene(context, model, 0)
    score = seen(model, truth, edges)
    before = score.points(truth)
    foretold = normal_motion(before, CAMERA, truth[:3, 3])
    for k, size in enumerate([0.002, 0.002, 0.01, 0.03, 0.03, 0.03]):
        step = size * np.eye(6)[k]
        after = score.points(retract(truth, step[None])[0])
        _, nearest = cKDTree(after.pixels).query(before.pixels)
        shift = ((after.pixels[nearest] - before.pixels) * before.normals).sum(axis=1)
        expected = foretold @ step
        # Nearest neighbours may be on another stretch, and pixels have their size.
        known = (after.normals[nearest] * before.normals).sum(axis=1) > 0.9
        assert known.mean() > 0.7
        assert np.abs(np.median((shift - expected)[known])) < 0.25
        if np.std(expected[known]) > 0.5:
            assert np.corrcoef(shift[known], expected[known])[0, 1] > 0.8


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_its_steps_lead_to_the_truth(context, seed):
    truth, edges = scene(context, CUP, seed)
    score = seen(CUP, truth, edges)
    rng = np.random.default_rng(seed)
    off = rng.choice([-1, 1], 6) * [0.0004, 0.0004, 0.002, 0.015, 0.015, 0.015]
    pose = retract(truth, off[None])[0]
    for _ in range(6):
        pose = retract(pose, about(score, edges, pose, CUP.symmetry).step[None])[0]
    left = CUP.symmetry.local(pose[None], truth)[0]
    assert np.linalg.norm(left[:3]) < 0.0025
    assert np.linalg.norm(left[3:]) < 0.03


def test_what_the_model_gets_wrong_widens_the_region(context):
    truth, edges = scene(context, CUP, 0)
    score = seen(CUP, truth, edges)
    sure, unsure = (about(score, edges, truth, CUP.symmetry, error)
                    for error in (ModelError(0, 0, 30), ModelError(0.5, 0.5, 30)))
    np.testing.assert_allclose(sure.model_error, 0)
    np.testing.assert_allclose(sure.covariance, unsure.covariance)
    assert np.linalg.eigvalsh(unsure.model_error).min() > 0
    assert 0 < sure.scale <= 1
    off = retract(truth, np.array([[0, 0, 0.004, 0, 0, 0]]))[0]
    wide = unsure.covariance + unsure.basis @ unsure.model_error @ unsure.basis.T
    assert (CUP.symmetry.credible_level(off, truth, wide)
            < CUP.symmetry.credible_level(off, truth, sure.covariance))


def test_where_nothing_is_seen_it_knows_nothing_but_stays_finite(context):
    truth, edges = scene(context, CUP, 0)
    away = truth.copy()
    away[0, 3] = 3
    model = about(seen(CUP, truth, edges), edges, away, CUP.symmetry)
    assert model.evidence == model.length == 0
    assert np.isfinite(model.covariance).all()
    assert np.isfinite(model.step).all()
    assert np.sqrt(np.diag(model.covariance)[2]) > 0.01


def test_energies_are_those_of_the_score(context):
    truth, edges = scene(context, BRACKET, 0)
    points = seen(BRACKET, truth, edges).points(truth)
    own = energies_across(edges, points.pixels, points.normals, points.depths, PROFILE.offsets)
    np.testing.assert_allclose(own, points.energies, atol=2e-3)
    np.testing.assert_allclose(PROFILE.evidence(own), points.evidence, atol=4e-3)
