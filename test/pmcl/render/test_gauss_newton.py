"""Climbs of many poses: against the score, the local model, and known truth."""

import numpy as np
import pytest
from pmcl_scenes import CAMERA, bracket, cup, depth_of, edges_seen, model_of, random_poses

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.gauss_newton import ContourExpansion, GaussNewton
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.view_terms import ViewContour
from pmcl_ros.runtime import kernels

DEPTHS = depth_labels(0.3, 0.7, 20)
CUP = model_of(cup(), [0, 0, 1])
BRACKET = model_of(bracket())
PROFILE = ContourProfile.learned()
REGION = Region((0, 0, 0.42), (0.2, 0.2, 0.2))
WHOLE = Window(0, 0, (CAMERA.width, CAMERA.height))


def seen(model, scale=1):
    return Scene(model, CAMERA, WHOLE.coarser(scale), 0.25, 0.75)


def climber(scene, edges, region=REGION):
    return GaussNewton([ContourExpansion(scene, edges, PROFILE, 1.0)], region)


@pytest.fixture(scope='module', params=[CUP, BRACKET], ids=['cup', 'bracket'])
def shown(request, _session_context):
    """A model, its pose, the edges of its contour in noise."""
    _session_context.use()
    model = request.param
    truth = random_poses(1, 2, depth=(0.4, 0.45), aside=0.01)[0]
    edges = edges_seen(depth_of(_session_context, model, truth, CAMERA, 4), CAMERA, DEPTHS,
                       0.2 * model.radius)
    noise = 0.1 * np.random.default_rng(0).random((*edges.tensor.shape[:3], 1)) * [1, 1, 0]
    tensor = (edges.tensor + noise).astype(np.float32)
    return model, truth, EdgeVolume(Header(), tensor, DEPTHS, CAMERA)


def beside(truth, count, size=1.0, seed=0):
    off = np.random.default_rng(seed).normal(size=(count, 6))
    return retract(truth, size * off * [0.0015, 0.0015, 0.005, 0.03, 0.03, 0.03])


@pytest.mark.parametrize('scale', [1, 2, 4])
def test_without_a_step_it_is_the_score(shown, scale):
    model, truth, edges = shown
    poses = np.concatenate([beside(truth, 20, 3), random_poses(10, 5)])
    climb = climber(seen(model, scale), edges, REGION)
    found, values = climb(poses, 0, 1.0, 0.1)
    np.testing.assert_array_equal(found, poses)
    assert climb.evaluations == len(poses)
    with NumbaRenderer().contour_score(seen(model, scale), edges, PROFILE) as score:
        sums = score.evaluate(poses)
    np.testing.assert_allclose(values, sums[:, 0], atol=1e-4 * sums[:, 1].max())


def test_its_first_step_is_the_local_models(shown):
    model, truth, edges = shown
    climb = climber(seen(model), edges, REGION)
    with NumbaRenderer().contour_score(seen(model), edges, PROFILE) as score:
        compared = 0
        for pose in beside(truth, 20, 0.7):
            local = LocalModel.from_views(
                pose, model.symmetry, [ViewContour(score.points(pose), edges, PROFILE)], None)
            found, values = climb(pose[None], 1, 1.0, 0.01)
            if values[0] == local.evidence or (found[0] == pose).all():
                continue  # that step led down
            step = model.symmetry.local(found, pose)[0]
            # Slopes and curvature are differences over twice as much, and half as much.
            assert local.motion(step - local.step) < 0.35
            assert local.motion(step) < 1.05  # that measure has a little more
            compared += 1
    assert compared >= 10


def test_it_leads_to_the_truth(shown):
    model, truth, edges = shown
    climb = climber(seen(model, 2), edges, REGION)
    start = beside(truth, 60)
    (_, before), (found, after) = climb(start, 0, 2.0, 0.05), climb(start, 12, 2.0, 0.05)
    assert (after >= before).all()
    best = found[np.argsort(-after)[:30]]
    shift = np.linalg.norm(best[:, :3, 3] - truth[:3, 3], axis=1)
    turn = model.symmetry.rotation_distance(best, truth)
    assert np.quantile(shift, 0.9) < 0.002
    assert np.quantile(turn, 0.9) < np.deg2rad(1)
    assert np.median(np.linalg.norm(start[:, :3, 3] - truth[:3, 3], axis=1)) > 0.003


def test_more_tries_go_higher_and_cost_no_more_than_they_are(shown):
    model, truth, edges = shown
    start, last = beside(truth, 30, 2), np.full(30, -np.inf)
    for tries in (0, 1, 3, 9):
        climb = climber(seen(model, 2), edges, REGION)
        _, values = climb(start, tries, 2.0, 0.1)
        assert (values >= last).all()
        assert len(start) <= climb.evaluations <= len(start) * (1 + tries)
        last = values


def test_each_pose_climbs_by_itself(shown):
    model, truth, edges = shown
    start = beside(truth, 9, 2)
    climb = climber(seen(model, 2), edges, REGION)
    together, alone = climb(start, 6, 2.0, 0.1), [climb(each[None], 6, 2.0, 0.1)
                                                  for each in start]
    np.testing.assert_array_equal(together[0], np.concatenate([each[0] for each in alone]))
    np.testing.assert_array_equal(together[1], np.concatenate([each[1] for each in alone]))
    np.testing.assert_allclose(np.linalg.det(together[0][:, :3, :3]), 1, atol=1e-9)


def test_none_leaves_the_region(shown):
    model, truth, edges = shown
    # The object itself lies just outside.
    region = Region(tuple(truth[:3, 3] + [0.012, 0, 0]), (0.02, 0.02, 0.04))
    start = beside(truth, 30)
    start[:, :3, 3] = region.clip(start[:, :3, 3])
    found, _ = climber(seen(model, 2), edges, region)(start, 8, 2.0, 0.05)
    assert region.contains(found[:, :3, 3]).all()
    assert (found != start).any()


def test_what_begins_outside_the_region_stays_there(shown):
    model, truth, edges = shown
    region = Region((0.5, 0, 0.42), (0.02, 0.02, 0.02))
    climb = climber(seen(model, 2), edges, region)
    for reach in ((8, 2.0, 0.05), (0, 0, 0)):
        np.testing.assert_array_equal(climb(beside(truth, 3), *reach)[0], beside(truth, 3))


def test_what_shows_nothing_stays_where_it_is():
    hidden = np.eye(4)
    hidden[:3, 3] = [5, 0, 0.4]
    region = Region((5, 0, 0.4), (0.1, 0.1, 0.1))
    tensor = np.random.default_rng(0).random((2, 3, 3, 3)).astype(np.float32)
    tiny = EdgeVolume(Header(), tensor, depth_labels(0.3, 0.6, 3),
                      Pinhole(3, 2, 300, 300, 1.5, 1))
    scene = Scene(CUP, tiny.pinhole, Window(0, 0, (3, 2)), 0.25, 0.75)
    found, values = climber(scene, tiny, region)(hidden[None], 5, 2.0, 0.1)
    np.testing.assert_array_equal(found[0], hidden)
    np.testing.assert_array_equal(values, 0)


def test_a_warm_climb_compiles_no_more(shown):
    model, truth, edges = shown
    GaussNewton.warm_up()
    compiled = []
    with kernels.reporting(compiled.append):
        climb = climber(seen(model, 2), edges, REGION)
        for reach in ((8, 2.0, 0.05), (0, 0, 0)):
            climb(beside(truth, 2)[::-1], *reach)
    assert not compiled


def test_two_views_expand_as_the_sum_of_each(shown):
    """Expansions are in the frame of the poses, whatever the cameras."""
    model, truth, edges = shown
    aside = np.linalg.inv(retract(np.eye(4)[None], np.array([[0.01, 0, 0, 0, 0.02, 0.05]]))[0])
    views = [ContourExpansion(seen(model), edges, PROFILE, 1.0, camera)
             for camera in (None, aside)]
    poses = beside(truth, 5)
    both = ContourExpansion.of_all(views, poses)
    assert [each.evaluations for each in views] == [5, 5]
    one, other = (ContourExpansion.of_all([each], poses) for each in views)
    for name in ('values', 'lengths', 'gradient', 'information', 'moments'):
        np.testing.assert_array_equal(getattr(both, name),
                                      getattr(one, name) + getattr(other, name))
    assert np.abs(one.gradient - other.gradient).max() > 0
