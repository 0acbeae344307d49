"""A contour moved as a wire, beside the same contour drawn anew."""

import numpy as np
import pytest
from pmcl_scenes import CAMERA, cup, depth_of, edges_seen, model_of, random_poses

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.pmcl.contour_approximations import RigidContour, shrunk
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window

DEPTHS = depth_labels(0.3, 0.7, 20)
CUP = model_of(cup(), [0, 0, 1])
PROFILE = ContourProfile.learned()


@pytest.fixture
def seen(context):
    """A pose, edges where it is seen, what scores any pose exactly."""
    truth = random_poses(1, 4, depth=(0.4, 0.45))[0]
    edges = edges_seen(depth_of(context, CUP, truth, CAMERA, 4), CAMERA, DEPTHS, 0.2 * CUP.radius)
    scene = Scene(CUP, CAMERA, Window(0, 0, (CAMERA.width, CAMERA.height)), 0.3, 0.6)
    return truth, edges, NumbaRenderer().contour_score(scene, edges, PROFILE)


def test_unmoved_it_is_worth_what_the_drawn_contour_is(seen):
    truth, edges, exact = seen
    wire = RigidContour.from_contour(truth, exact.points(truth), CAMERA, 10_000)
    assert wire.evidence(truth[None], edges, PROFILE)[0] == pytest.approx(exact(truth[None])[0],
                                                                          rel=0.02)


def test_few_points_say_nearly_the_same(seen):
    truth, edges, exact = seen
    points = exact.points(truth)
    wires = (RigidContour.from_contour(truth, points, CAMERA, count) for count in (64, 10_000))
    few, all_ = (each.evidence(truth[None], edges, PROFILE)[0] for each in wires)
    assert few == pytest.approx(all_, rel=0.1)


def test_from_another_pose_it_is_best_where_the_object_is(seen):
    truth, edges, exact = seen
    other = truth.copy()
    other[:3, 3] += [0.02, -0.015, 0.01]
    wire = RigidContour.from_contour(other, exact.points(other), CAMERA, 64)
    shifts = np.stack(np.meshgrid(*[np.linspace(-0.02, 0.02, 9)] * 2, [0.0]),
                      axis=-1).reshape(-1, 3)
    tried = np.tile(truth, (len(shifts), 1, 1))
    tried[:, :3, 3] += shifts
    values = wire.evidence(tried, edges, PROFILE)
    assert values.argmax() == np.linalg.norm(shifts, axis=1).argmin()


def test_out_of_view_nothing_speaks_for_or_against(seen):
    truth, edges, exact = seen
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
