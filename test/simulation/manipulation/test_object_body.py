"""Objects as rigid bodies: inertia and convex pieces; water that carries them."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.manipulation.buoyancy import Water, sample_volume
from pmcl_ros.simulation.manipulation.object_body import convex_pieces, shell
from pmcl_ros.simulation.manipulation.workplace import OBJECTS

OBJECTS_FOLDER = Path(__file__).parents[3] / 'config' / 'objects'
G = 9.81


def model_of(mesh):
    return ObjectModel('object', np.asarray(mesh.vertices), np.asarray(mesh.faces), None, True)


@pytest.fixture(scope='module')
def bottle():
    return ObjectModel.load(OBJECTS_FOLDER / 'bottle.yaml')


@pytest.fixture(scope='module')
def tumbler():
    return ObjectModel.load(OBJECTS_FOLDER / 'tumbler.yaml')


def test_a_shell_has_the_inertia_of_a_hollow_sphere():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    ball.apply_translation([0.3, 0, -0.2])
    centre, inertia = shell(model_of(ball), 0.6)
    assert centre == pytest.approx([0.3, 0, -0.2], abs=1e-6)
    assert inertia == pytest.approx(2 / 3 * 0.6 * 0.1 ** 2 * np.eye(3), rel=0.01, abs=1e-9)


def test_convex_things_are_one_piece(tumbler):
    assert len(convex_pieces(tumbler)) == 1


def test_convex_pieces_fill_the_mesh_and_hardly_more(bottle):
    pieces = [ConvexHull(points) for points in convex_pieces(bottle)]
    volume = trimesh.Trimesh(bottle.vertices, bottle.faces).volume
    assert sum(piece.volume for piece in pieces) == pytest.approx(volume, rel=0.02)
    assert ConvexHull(bottle.vertices).volume > 1.03 * volume  # one would not do
    inside = [(piece.equations[:, :3] @ bottle.vertices.T + piece.equations[:, 3:]
               ).max(axis=0) < 1e-6 for piece in pieces]
    assert np.any(inside, axis=0).all()


def test_water_pushes_by_the_weight_of_what_it_yields(bottle):
    water = Water(bottle, 0.0, np.zeros(2), np.random.default_rng(0))
    volume = trimesh.Trimesh(bottle.vertices, bottle.faces).volume
    still, pose = np.zeros(3), np.eye(4)
    pose[2, 3] = -1.0
    force = water.force(pose, pose[:3, 3], np.array([0, 0, 0.0]), still, 0.0)
    assert force[2] == pytest.approx(1000 * G * volume, rel=1e-6)
    pose[2, 3] = 1.0
    assert water.force(pose, pose[:3, 3], still, still, 0.0) == pytest.approx(np.zeros(6))


def test_the_push_grows_smoothly(bottle):
    water = Water(bottle, 0.0, np.zeros(2), np.random.default_rng(0))
    pushes = []
    for depth in np.arange(0, 0.3, 0.0005):
        pose = np.eye(4)
        pose[2, 3] = -depth
        pushes.append(water.force(pose, pose[:3, 3], np.zeros(3), np.zeros(3), 0.0)[2])
    steps = np.diff(pushes)
    widest = 1000 * G * np.pi * 0.0415 ** 2 * 0.0005
    assert (steps >= -1e-9).all()
    assert steps.max() < 1.15 * widest


def test_samples_stand_for_the_volume(bottle):
    points, volume = sample_volume(bottle)
    mesh = trimesh.Trimesh(bottle.vertices, bottle.faces)
    assert volume * len(points) == pytest.approx(mesh.volume)
    assert points.mean(axis=0) == pytest.approx(mesh.center_mass, abs=0.002)


def test_the_bottle_floats_as_deep_as_tasks_draw_it(bottle):
    points, volume = sample_volume(bottle)
    low, high = bottle.vertices[:, 2].min(), bottle.vertices[:, 2].max()
    below = (points[:, 2] < low + 0.6 * (high - low)).sum()
    assert 1000.0 * volume * below == pytest.approx(OBJECTS['tank'][1], rel=0.02)
