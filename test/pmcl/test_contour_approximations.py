"""The linearized and the rigid contour, against the evidence of rendered poses."""

import numpy as np
import pytest
from pmcl_scenes import CAMERA, cup, depth_of, edges_seen, model_of, random_poses

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.energies import energies_across, evidence_across
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.contour_approximations import LinearizedContour, RigidContour, shrunk
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.view_terms import ViewContour

CUP = model_of(cup(), [0, 0, 1])
PROFILE = ContourProfile.learned()
DEPTHS = depth_labels(0.3, 0.7, 20)
SIGMA = np.array([0.0006, 0.0006, 0.003, 0.01, 0.01, 0.01])


def linearizable(context):
    truth = random_poses(1, 0, depth=(0.4, 0.45), aside=0.01)[0]
    depth = depth_of(context, CUP, truth, CAMERA, 4)
    edges = edges_seen(depth, CAMERA, DEPTHS, 0.2 * CUP.radius)
    scene = Scene(CUP, CAMERA, Window(0, 0, (CAMERA.width, CAMERA.height)), 0.25, 0.75)
    return truth, edges, NumbaRenderer().contour_score(scene, edges, PROFILE)


def test_it_tells_what_poses_nearby_are_worth(context):
    truth, edges, score = linearizable(context)
    slide = LinearizedContour.from_view(
        truth, ViewContour(score.points(truth), edges, PROFILE))
    off = SIGMA * np.random.default_rng(0).normal(size=(100, 6))
    told, exact = slide.evidence(off), score(retract(truth, off))
    assert np.corrcoef(told, exact)[0, 1] > 0.9
    assert np.std(told - exact) < 0.4 * np.std(exact)
    np.testing.assert_allclose(slide.evidence(np.zeros((1, 6))), score(truth[None]), rtol=0.01)


def test_farther_than_the_table_goes_its_end_counts(context):
    truth, edges, score = linearizable(context)
    slide = LinearizedContour.from_view(
        truth, ViewContour(score.points(truth), edges, PROFILE))
    far, farther = slide.evidence(np.array([[0.5, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0]]))
    # A point whose normal is along y goes nowhere, all others are beyond.
    assert np.isfinite([far, farther]).all()
    assert abs(far - farther) < 0.05 * abs(slide.table).sum(axis=0).max()
    assert len(slide.evidence(np.zeros((0, 6)))) == 0


def test_shifted_evidence_is_that_of_shifted_energies(context):
    truth, edges, score = linearizable(context)
    points = score.points(truth)
    where = points.pixels, points.normals, points.depths
    shifts = np.array([-2.0, -0.5, 0.0, 1.0, 3.5])
    found = evidence_across(edges, *where, PROFILE, shifts)
    for column, shift in zip(found.T, shifts, strict=True):
        energies = energies_across(edges, *where, PROFILE.offsets + shift)
        np.testing.assert_allclose(column, PROFILE.evidence(energies), atol=1e-5)


@pytest.fixture
def sighting(context):
    """A pose, the edges it gives, and the exact score of poses."""
    truth = random_poses(1, 4, depth=(0.4, 0.45))[0]
    edges = edges_seen(depth_of(context, CUP, truth, CAMERA, 4), CAMERA, DEPTHS, 0.2 * CUP.radius)
    scene = Scene(CUP, CAMERA, Window(0, 0, (CAMERA.width, CAMERA.height)), 0.3, 0.6)
    return truth, edges, NumbaRenderer().contour_score(scene, edges, PROFILE)


def test_unmoved_it_is_worth_what_the_drawn_contour_is(sighting):
    truth, edges, exact = sighting
    wire = RigidContour.from_contour(truth, exact.points(truth), CAMERA, 10_000)
    assert wire.evidence(truth[None], edges, PROFILE)[0] == pytest.approx(exact(truth[None])[0],
                                                                          rel=0.02)


def test_few_points_say_nearly_the_same(sighting):
    truth, edges, exact = sighting
    points = exact.points(truth)
    wires = (RigidContour.from_contour(truth, points, CAMERA, count) for count in (64, 10_000))
    few, all_ = (each.evidence(truth[None], edges, PROFILE)[0] for each in wires)
    assert few == pytest.approx(all_, rel=0.1)


def test_from_another_pose_it_is_best_where_the_object_is(sighting):
    truth, edges, exact = sighting
    other = truth.copy()
    other[:3, 3] += [0.02, -0.015, 0.01]
    wire = RigidContour.from_contour(other, exact.points(other), CAMERA, 64)
    shifts = np.stack(np.meshgrid(*[np.linspace(-0.02, 0.02, 9)] * 2, [0.0]),
                      axis=-1).reshape(-1, 3)
    tried = np.tile(truth, (len(shifts), 1, 1))
    tried[:, :3, 3] += shifts
    values = wire.evidence(tried, edges, PROFILE)
    assert values.argmax() == np.linalg.norm(shifts, axis=1).argmin()


def test_out_of_view_nothing_speaks_for_or_against(sighting):
    truth, edges, exact = sighting
    wire = RigidContour.from_contour(truth, exact.points(truth), CAMERA, 64)
    away = np.tile(truth, (2, 1, 1))
    away[:, :3, 3] = [[1.0, 0, 0.4], [0, 0, -0.4]]
    np.testing.assert_array_equal(wire.evidence(away, edges, PROFILE), 0)


@pytest.mark.parametrize('scale', [1, 2, 4])
def test_shrunk_edges_are_means_seen_by_a_camera_of_larger_pixels(scale):
    rng = np.random.default_rng(scale)
    edges = EdgeVolume(Header(3), rng.random((CAMERA.height, CAMERA.width, 2, 3), np.float32),
                       depth_labels(0.3, 0.7, 2), CAMERA)
    small = shrunk(edges, scale)
    np.testing.assert_allclose(small.tensor[2, 5], edges.tensor[
        2 * scale:3 * scale, 5 * scale:6 * scale].mean(axis=(0, 1)), rtol=1e-5)
    point = np.array([0.03, -0.02, 0.4])
    # Pixel k of the small picture is the middle of pixels k * scale ... of the large one.
    np.testing.assert_allclose(small.pinhole.project(point) * scale + (scale - 1) / 2,
                               CAMERA.project(point), atol=1e-9)
