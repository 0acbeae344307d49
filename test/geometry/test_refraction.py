"""Where things under water seem to be: Snell's law, and the kernel that draws them there."""

import numpy as np
import pytest
import trimesh

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.level_of_detail import longest_edge, subdivided
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window

CAMERA = Pinhole(320, 240, 300.0, 300.0, 159.5, 119.5)
UP = np.array([0, -np.sqrt(0.5), -np.sqrt(0.5)])  # of a camera that looks down at 45 degrees
WATER = Interface(-0.3 * UP[None], UP[None], 1.33)
# A tank 0.3 m ahead, its surface 0.02 m below the camera.
FACES = np.array([[0, -1.0, 0], [0, 0, -1.0]])
TANK = Interface(-np.diag([0.02, 0.3]) @ FACES, FACES, 1.33)


def test_rays_to_where_things_appear_obey_snells_law():
    points = np.random.default_rng(0).uniform([-0.5, -0.5, 0], [0.5, 0.5, 1.5], (500, 3))
    seen = WATER.apparent(points)
    below = points @ UP < -0.3
    assert 100 < below.sum() < 450
    np.testing.assert_array_equal(seen[~below], points[~below])
    points, seen = points[below], seen[below]
    np.testing.assert_allclose(np.cross(seen - points, UP), 0, atol=1e-12)  # straight above
    meets = seen * (-0.3 / (seen @ UP))[:, None]  # the ray from the origin, at the water
    into = points - meets
    above = np.linalg.norm(np.cross(meets, UP), axis=1) / np.linalg.norm(meets, axis=1)
    under = np.linalg.norm(np.cross(into, UP), axis=1) / np.linalg.norm(into, axis=1)
    np.testing.assert_allclose(above, 1.33 * under, atol=1e-6)


def test_rays_into_a_tank_are_bent_where_they_enter_it():
    points = np.random.default_rng(3).uniform([-0.3, -0.1, 0.2], [0.3, 0.3, 0.7], (800, 3))
    seen = TANK.apparent(points)
    wet = (points[:, 1] > 0.02) & (points[:, 2] > 0.3)
    np.testing.assert_array_equal(seen[~wet], points[~wet])
    points, seen = points[wet], seen[wet]
    shift = seen - points
    through = [np.abs(shift @ face) > 0.999 * np.linalg.norm(shift, axis=1) for face in FACES]
    assert (through[0] ^ through[1]).all()  # towards the surface or towards the front
    assert min(each.sum() for each in through) > 5
    for number, which in enumerate(through):
        face, height = FACES[number], TANK.heights[number]
        meets = seen[which] * (-height / (seen[which] @ face))[:, None]
        into = points[which] - meets
        above, under = (np.linalg.norm(np.cross(each, face), axis=1)
                        / np.linalg.norm(each, axis=1) for each in (meets, into))
        np.testing.assert_allclose(above, 1.33 * under, atol=1e-6)
        beside = TANK.heights[1 - number] + meets @ FACES[1 - number]
        assert (beside < 1e-5).mean() > 0.9  # else it is behind the corner, where no ray gets


def test_a_tank_from_below_its_surface_is_its_front():
    low = Interface(np.array([[0, -0.1, 0], [0, 0, 0.3]]), FACES, 1.33)
    points = np.random.default_rng(4).uniform([-0.3, 0.0, 0.31], [0.3, 0.3, 0.7], (100, 3))
    front = Interface(low.points[1:], FACES[1:], 1.33)
    np.testing.assert_allclose(low.apparent(points), front.apparent(points))


@pytest.mark.parametrize('up', [UP, np.array([0, 0, -1.0])], ids=['oblique', 'looking down'])
def test_straight_down_depths_are_divided_by_the_index(up):
    seen = Interface(-0.3 * up[None], up[None], 1.33).apparent(-0.7 * up[None])
    np.testing.assert_allclose(seen[0], -(0.3 + 0.4 / 1.33) * up, atol=1e-9)


@pytest.mark.parametrize('water', [WATER, TANK], ids=['water', 'tank'])
def test_snells_law_knows_no_lengths(water):
    larger = Interface(10 * water.points, water.normals, water.index)
    points = np.random.default_rng(5).uniform([-0.5, -0.5, 0], [0.5, 0.5, 1.5], (500, 3))
    np.testing.assert_allclose(larger.apparent(10 * points), 10 * water.apparent(points),
                               atol=1e-6)


def test_in_the_water_nothing_is_bent():
    flipped = Interface(0.3 * UP[None], UP[None], 1.33)
    points = np.random.default_rng(1).normal(size=(20, 3))
    assert flipped.heights < 0
    np.testing.assert_array_equal(flipped.apparent(points), points)


def test_an_interface_moves_with_the_camera():
    angle = 0.4
    camera = np.eye(4)
    camera[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    camera[:3, 3] = 0.1, -0.2, 0.7
    points = np.random.default_rng(2).normal(size=(50, 3))
    moved = WATER.seen_from(camera)
    into = np.linalg.inv(camera)
    there = points @ into[:3, :3].T + into[:3, 3]
    np.testing.assert_allclose((there - moved.points[0]) @ moved.normals[0],
                               (points - WATER.points[0]) @ WATER.normals[0], atol=1e-12)


@pytest.mark.parametrize(('place', 'water'), [
    ((0.02, 0.03, 0.5), WATER), ((0.02, -0.02, 0.42), WATER), ((-0.26, 0.1, 0.5), WATER),
    ((0.02, 0.02, 0.5), TANK), ((-0.22, 0.16, 0.45), TANK)],
    ids=['below', 'half below', 'at the edge of the picture', 'in a tank', 'at its edge'])
def test_the_processor_draws_what_is_below_where_it_appears(place, water):
    ball = trimesh.creation.icosphere(4, 0.04)
    model = ObjectModel('ball', np.asarray(ball.vertices), np.asarray(ball.faces), None, True)
    pose = np.eye(4)
    pose[:3, 3] = place
    window = Window(0, 0, (320, 240))
    drawn = NumbaRenderer().depths(Scene(model, CAMERA, window, 0.1, 1.0, water), pose[None])[0]
    raised = ObjectModel('ball', water.apparent(model.vertices + pose[:3, 3]), model.faces, None,
                         True)
    expected = NumbaRenderer().depths(Scene(raised, CAMERA, window, 0.1, 1.0), np.eye(4)[None])[0]
    assert (drawn > 0).sum() > 500
    assert ((drawn > 0) != (expected > 0)).sum() <= 2
    both = (drawn > 0) & (expected > 0)
    np.testing.assert_allclose(drawn[both], expected[both], atol=1e-4)


def test_a_finer_mesh_is_the_same_surface():
    tube = trimesh.creation.cylinder(0.03, 0.1, sections=16)
    model = ObjectModel('tube', np.asarray(tube.vertices), np.asarray(tube.faces), None, True)
    fine = subdivided(model)
    mesh = trimesh.Trimesh(fine.vertices, fine.faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(tube.volume)
    assert mesh.edges_unique_length.max() <= longest_edge(model)


def test_contours_near_the_surface_are_left_out():
    ball = trimesh.creation.icosphere(4, 0.04)
    model = ObjectModel('ball', np.asarray(ball.vertices), np.asarray(ball.faces), None, True)
    pose = np.eye(4)
    pose[:3, 3] = 0.02, -0.01, 0.43  # half below
    edges = EdgeVolume(Header(), np.zeros((240, 320, 2, 3), np.float32), np.array([0.8, 0.2]),
                       CAMERA)
    window = Window(0, 0, (320, 240))
    wet, dry = (NumbaRenderer().contour_score(
        Scene(subdivided(model), CAMERA, window, 0.1, 1.0, each), edges,
        ContourProfile.contrast()).points(pose) for each in (WATER, None))
    rays = np.column_stack([(wet.pixels - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx,
                            np.ones(len(wet.pixels))])
    away = np.abs(wet.depths[:, None] * rays @ UP + 0.3)
    assert away.min() > longest_edge(model) / 2
    assert 0.5 * dry.lengths.sum() < wet.lengths.sum() < dry.lengths.sum()
