"""The table of a contour that slides, against the evidence of rendered poses."""

import numpy as np
from pmcl_scenes import CAMERA, cup, depth_of, edges_seen, model_of, random_poses

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.energies import energies_across, evidence_across
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.contour_approximations import LinearizedContour
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window

CUP = model_of(cup(), [0, 0, 1])
PROFILE = ContourProfile.learned()
DEPTHS = depth_labels(0.3, 0.7, 20)
SIGMA = np.array([0.0006, 0.0006, 0.003, 0.01, 0.01, 0.01])


def seen(context):
    truth = random_poses(1, 0, depth=(0.4, 0.45), aside=0.01)[0]
    depth = depth_of(context, CUP, truth, CAMERA, 4)
    edges = edges_seen(depth, CAMERA, DEPTHS, 0.2 * CUP.radius)
    scene = Scene(CUP, CAMERA, Window(0, 0, (CAMERA.width, CAMERA.height)), 0.25, 0.75)
    return truth, edges, NumbaRenderer().contour_score(scene, edges, PROFILE)


def test_it_tells_what_poses_nearby_are_worth(context):
    truth, edges, score = seen(context)
    slide = LinearizedContour.from_contour(truth, score.points(truth), edges, PROFILE)
    off = SIGMA * np.random.default_rng(0).normal(size=(100, 6))
    told, exact = slide.evidence(off), score(retract(truth, off))
    assert np.corrcoef(told, exact)[0, 1] > 0.9
    assert np.std(told - exact) < 0.4 * np.std(exact)
    np.testing.assert_allclose(slide.evidence(np.zeros((1, 6))), score(truth[None]), rtol=0.01)


def test_farther_than_the_table_goes_its_end_counts(context):
    truth, edges, score = seen(context)
    slide = LinearizedContour.from_contour(truth, score.points(truth), edges, PROFILE)
    far, farther = slide.evidence(np.array([[0.5, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0]]))
    # A point whose normal is along y goes nowhere, all others are beyond.
    assert np.isfinite([far, farther]).all()
    assert abs(far - farther) < 0.05 * abs(slide.table).sum(axis=0).max()
    assert len(slide.evidence(np.zeros((0, 6)))) == 0


def test_shifted_evidence_is_that_of_shifted_energies(context):
    truth, edges, score = seen(context)
    points = score.points(truth)
    where = points.pixels, points.normals, points.depths
    shifts = np.array([-2.0, -0.5, 0.0, 1.0, 3.5])
    found = evidence_across(edges, *where, PROFILE, shifts)
    for column, shift in zip(found.T, shifts, strict=True):
        energies = energies_across(edges, *where, PROFILE.offsets + shift)
        np.testing.assert_allclose(column, PROFILE.evidence(energies), atol=1e-5)
