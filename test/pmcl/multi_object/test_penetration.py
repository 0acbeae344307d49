"""Depth of points in objects, and how objects in each other are moved apart."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import model_of, pose_of
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_object.penetration import (
    MAX_PENETRATION,
    Interior,
    PlacedObject,
    contact,
    deepest_penetration,
    outside_of,
    resolve_penetration,
)

NEAR = 0.0006  # m: points on the surface are about that far apart


def interior_of(mesh):
    return Interior.from_model(model_of(mesh))


BALL = interior_of(trimesh.creation.icosphere(4, 0.03))
BOX = interior_of(trimesh.creation.box((0.04, 0.06, 0.1)))


def test_depth_in_a_ball():
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (500, 3))
    depths, out = BALL.depths(points)
    expected = 0.03 - np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(depths, expected, atol=NEAR)
    inside = expected > 0.005
    radial = points / np.linalg.norm(points, axis=1, keepdims=True)
    middle = np.linalg.norm(points, axis=1) > 0.01
    assert ((out * radial).sum(axis=1) > 0.99)[inside & middle].all()


def test_depth_in_a_box_is_that_of_its_nearest_side_corner_or_edge():
    points = np.random.default_rng(1).uniform(-0.07, 0.07, (2000, 3))
    beyond = np.abs(points) - np.array([0.02, 0.03, 0.05])
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    expected = np.where(outside > 0, -outside, -beyond.max(axis=1))
    found = BOX.depths(points)[0]
    np.testing.assert_allclose(found[expected > 0], expected[expected > 0], atol=NEAR)
    np.testing.assert_allclose(found, expected, atol=2 * NEAR)


def test_a_little_below_a_flat_side_the_depth_is_exact():
    points = np.random.default_rng(2).uniform([-0.015, -0.025, 0.049], [0.015, 0.025, 0.049],
                                              (500, 3))
    np.testing.assert_allclose(BOX.depths(points)[0], 0.001, atol=1e-9)


def test_behind_an_edge_that_points_inwards_the_depth_is_to_the_edge():
    """That of a head on a neck."""
    outline = [(0, -0.05), (0.02, -0.05), (0.02, 0), (0.05, 0), (0.05, 0.05), (0, 0.05)]
    solid = interior_of(trimesh.creation.revolve(outline, sections=96))
    angle = np.linspace(0, 2 * np.pi, 100)
    for within, above in ((0.0005, 0.004), (0.004, 0.0005)):
        radius = 0.02 - within
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle),
                           np.full(100, above)], axis=1)
        np.testing.assert_allclose(solid.depths(points)[0], np.hypot(within, above), atol=NEAR)


def test_the_largest_ball_in_a_box():
    assert BOX.core_radius == pytest.approx(0.02, abs=NEAR)
    assert np.abs(BOX.core[0]) < 0.001
    assert (np.abs(BOX.core[1:]) < [0.011, 0.031]).all()


@pytest.mark.parametrize('apart', [0.005, 0.02, 0.05, 0.058])
def test_two_balls_are_as_deep_in_each_other_as_their_centres_say(apart):
    turn = Rotation.from_euler('xyz', [0.3, 0.5, 0.7])
    place = np.array([0.1, -0.2, 0.5])
    way = np.array([0.6, 0.0, 0.8])
    found = contact(BALL, pose_of(turn.inv(), place + apart * way), BALL, pose_of(turn, place))
    # Of a point of its surface, or of its middle.
    assert found.depth == pytest.approx(0.03 - min(apart, abs(0.03 - apart)), abs=2 * NEAR)
    np.testing.assert_allclose(found.normal, way, atol=0.12)
    back = contact(BALL, pose_of(turn, place), BALL, pose_of(turn, place + apart * way))
    assert back.depth == pytest.approx(found.depth, abs=2 * NEAR)
    np.testing.assert_allclose(back.normal, -way, atol=0.12)
    assert np.linalg.norm(found.normal) == pytest.approx(1, abs=1e-9)
    outside = contact(BALL, pose_of(turn, place), BALL, pose_of(turn, place + 0.061 * way))
    assert outside.depth < 0


def test_a_corner_of_a_box_is_the_deepest_point_in_a_ball():
    box = pose_of(Rotation.from_euler('xyz', [0.3, 0.5, 0.7]), [0.1, -0.2, 0.5])
    corner, way = box[:3, :3] @ [0.02, 0.03, 0.05] + box[:3, 3], box[:3, :3] @ [0.6, 0.64, 0.48]
    ball = pose_of(Rotation.from_euler('xyz', [2.0, 0.1, -1.0]), corner + 0.025 * way)
    for sign, found in ((1, contact(BALL, ball, BOX, box)), (-1, contact(BOX, box, BALL, ball))):
        assert found.depth == pytest.approx(0.005, abs=NEAR)
        np.testing.assert_allclose(found.place, corner, atol=1e-9)
        np.testing.assert_allclose(found.normal, sign * way, atol=0.1)


@pytest.mark.parametrize('turn', [[0, 0, 0], [np.pi, 0, 0]])
@pytest.mark.parametrize('shift', [0.0, 0.0005])
def test_two_objects_in_one_place_are_deep_in_each_other(turn, shift):
    place = np.array([0.1, -0.2, 0.5])
    other = pose_of(Rotation.from_euler('xyz', turn), place + np.array([shift, 0, 0]))
    for each in (BALL, BOX):
        found = contact(each, pose_of(Rotation.identity(), place), each, other)
        assert found.depth > each.core_radius - 0.002
        assert np.linalg.norm(found.normal) == pytest.approx(1, abs=1e-6)


def test_a_ball_in_a_jar_is_in_its_cavity_if_the_mesh_has_one():
    outer, inner = [(0, -0.05), (0.05, -0.05), (0.05, 0.05)], [(0.045, 0.05), (0.045, -0.045),
                                                               (0, -0.045)]
    jar = interior_of(trimesh.creation.revolve([*outer, *inner], sections=48))
    closed = interior_of(trimesh.creation.revolve([*outer, (0, 0.05)], sections=48))
    assert jar.closed
    assert closed.closed
    here = np.eye(4)
    assert contact(BALL, here, jar, here).depth < 0
    assert contact(BALL, here, closed, here).depth > 0.02
    aside = pose_of(Rotation.identity(), [0.02, 0, 0])
    assert contact(BALL, aside, jar, here).depth > 0.001


def test_nothing_is_in_a_mesh_that_is_not_closed(caplog):
    mesh = trimesh.creation.cone(0.05, 0.1, sections=16)
    mesh.update_faces(np.arange(len(mesh.faces)) > 1)
    sheet = interior_of(mesh)
    assert 'not closed' in caplog.text
    assert sheet.core_radius == 0
    assert contact(sheet, np.eye(4), sheet, np.eye(4)).depth <= 0
    assert contact(BALL, at(0, 0, 0.05), sheet, np.eye(4)).depth > 0.005  # it is in the ball
    assert contact(BALL, at(-0.065, -0.065, 0), sheet, np.eye(4)).depth < 0


SURE = np.diag([1e-8, 1e-8, 1e-8, 1e-6, 1e-6, 1e-6])
DEEP = np.diag([1e-8, 1e-8, 25e-6, 1e-6, 1e-6, 1e-6])  # 5 mm along the line of sight


def at(x, y, z):
    return pose_of(Rotation.identity(), [x, y, z])


def test_the_less_sure_one_moves_and_along_the_way_it_is_unsure_of():
    things = [PlacedObject(BALL, at(0.01, 0, 0.5), SURE), PlacedObject(BALL, at(0, 0, 0.55), DEEP)]
    found = resolve_penetration(things)
    assert 0.0002 < found.depth < 0.001  # no farther than is wanted
    first, second = np.abs(found.deviations[:, :3])
    assert second[2] > 20 * first.max()
    assert second[2] > 20 * second[:2].max()
    assert found.cost == pytest.approx(0.5 * (second[2] / 0.005) ** 2, rel=0.05)


def test_what_is_unsure_of_its_turn_alone_turns_away():
    wide = 1e-12 * np.eye(6)
    wide[4, 4] = 0.1 ** 2
    # 4 mm deep in its side, 4 cm from its middle.
    things = [PlacedObject(BOX, at(0, 0, 0.5), wide),
              PlacedObject(BALL, at(0.046, 0, 0.54), 1e-12 * np.eye(6))]
    found = resolve_penetration(things)
    assert found.depth <= MAX_PENETRATION
    turn = found.deviations[0, 4]
    assert turn == pytest.approx(-0.004 / 0.04, rel=0.3)
    assert found.cost == pytest.approx(0.5 * (turn / 0.1) ** 2, rel=0.05)


def test_a_turn_about_the_axis_of_symmetry_takes_nothing_out():
    pose = pose_of(Rotation.from_euler('xyz', [0.3, 0.5, 0.7]), [0.1, 0, 0.5])
    round_ = Symmetry(np.array([0, 0, 1.0]))
    estimate = PoseEstimate(Header(1), pose, np.eye(6), pose[None], np.zeros(1), 1.0, False,
                            'default')
    spin = np.concatenate([np.zeros(3), pose[:3, 2]])
    for symmetry, left in ((Symmetry(), np.eye(6)), (round_, np.eye(6) - np.outer(spin, spin))):
        placed = PlacedObject.from_estimate(BALL, estimate, symmetry)
        np.testing.assert_allclose(placed.covariance, left, atol=1e-9)


def test_what_is_apart_stays_and_what_costs_too_much_is_given_up():
    far = [PlacedObject(BALL, at(0, 0, 0.5), SURE), PlacedObject(BALL, at(0.07, 0, 0.5), SURE)]
    found = resolve_penetration(far)
    assert not found.deviations.any()
    assert found.cost == 0
    assert deepest_penetration([(each.interior, each.pose) for each in far]) == 0
    near = [PlacedObject(BALL, at(0, 0, 0.5), SURE), PlacedObject(BALL, at(0.0585, 0, 0.5), SURE)]
    assert 0.0002 < resolve_penetration(near).depth < 0.001
    same = [PlacedObject(BALL, at(0, 0, 0.5), SURE), PlacedObject(BALL, at(0.01, 0, 0.5), SURE)]
    given_up = resolve_penetration(same, most=10.0)
    assert given_up.cost > 10
    assert resolve_penetration([]).depth == -np.inf


def test_what_is_far_inside_is_not_outside():
    outside = outside_of(BALL, [(BOX, at(0, 0, 0.5)), (BALL, at(0, 0.2, 0.5))])
    poses = np.stack([at(0.051, 0, 0.5), at(0.02, 0, 0.5), at(0, 0.16, 0.5), at(0, 0.15, 0.5)])
    np.testing.assert_array_equal(outside(poses), [True, False, False, True])


def test_an_inscribed_ball_turns_with_its_object():
    """One of 2 cm, 3 cm aside of the origin, and one of 3 cm about it."""
    small = interior_of(trimesh.creation.icosphere(3, 0.02).apply_translation([0, 0.03, 0]))
    turn = Rotation.from_euler('xyz', [0.3, 0.5, 0.7])
    place = pose_of(turn, np.array([0.1, 0, 0.5]) - turn.apply([0, 0.03, 0]))
    for apart, free in ((0.036, False), (0.044, True)):
        other = pose_of(turn, np.array([0.1, 0, 0.5]) + apart * np.array([0.6, 0, 0.8]))
        assert outside_of(small, [(BALL, other)])(place[None]) == free
        assert outside_of(BALL, [(small, place)])(other[None]) == free


@settings(max_examples=8, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=12, max_size=12))
def test_any_three_are_apart_in_the_end(numbers):
    spots = np.array(numbers[:9]).reshape(3, 3) * 0.03 + [0, 0, 0.5]
    spots += [[0, 0, 0], [0.05, 0, 0], [0, 0.06, 0]]
    turn = Rotation.from_rotvec(numbers[9:])
    wide = np.diag([1e-4] * 3 + [1e-2] * 3)
    things = [PlacedObject(interior, pose_of(turn, spot), wide)
              for interior, spot in zip((BALL, BOX, BALL), spots, strict=True)]
    found = resolve_penetration(things)
    after = [(each.interior, retract(each.pose, off[None])[0])
             for each, off in zip(things, found.deviations, strict=True)]
    depth = deepest_penetration(after)
    assert depth == pytest.approx(max(found.depth, depth))
    assert found.depth <= MAX_PENETRATION
