"""Vessels, patterns, rooms and pupils that scenes are made of."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_scenes import plain_scene, pose_at
from scipy.spatial.transform import Rotation

from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.simulation.scenes.environment import (
    Environment,
    look_up,
    random_environment,
    shade,
)
from pmcl_ros.simulation.scenes.poses import camera_above, resting
from pmcl_ros.simulation.scenes.random_scene import SceneSettings
from pmcl_ros.simulation.scenes.scene import Sheet
from pmcl_ros.simulation.scenes.sensor import pupil_views
from pmcl_ros.simulation.scenes.shapes.vessels import KINDS, outer_mesh, random_vessel
from pmcl_ros.simulation.scenes.textures import PATTERNS, SIZE
from pmcl_ros.simulation.scenes.world import World


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10 ** 6), st.sampled_from(list(KINDS)))
def test_a_vessel_has_walls_and_a_closed_mesh(seed, kind):
    vessel = random_vessel(np.random.default_rng(seed), (kind,))
    mesh = trimesh.Trimesh(*outer_mesh(vessel.closed), process=False)
    assert mesh.is_volume
    assert mesh.volume > 0
    height = np.ptp(vessel.outer[:, 1])
    assert mesh.bounds[:, 2] == pytest.approx([-height / 2, height / 2])
    assert 0.02 < height < 0.25
    assert 0.01 < vessel.outer[:, 0].max() < 0.08
    # The cavity lies within the outer surface, about as far from it as the thinnest wall.
    points = vessel.inner[vessel.inner[:, 1] < vessel.outer[-1, 1] - 0.004]
    corners = np.stack([vessel.closed[:-1], vessel.closed[1:]], axis=1)
    along = corners[:, 1] - corners[:, 0]
    part = (((points[:, None] - corners[:, 0]) * along).sum(axis=-1)
            / np.maximum((along ** 2).sum(axis=-1), 1e-18)).clip(0, 1)
    away = np.linalg.norm(corners[:, 0] + part[..., None] * along - points[:, None], axis=-1)
    assert away.min() > 0.0009


def test_a_bottle_whose_wall_leaves_no_cavity_is_of_solid_glass():
    vessel = random_vessel(np.random.default_rng(136), ('bottle',), (0.006, 0.008))
    below = vessel.inner[:, 1] < vessel.outer[-1, 1] - 0.005
    assert not below[:-1].any()  # the last point is the floor
    assert vessel.inner[-1, 0] == 0
    assert np.isfinite(vessel.inner).all()
    assert trimesh.Trimesh(*outer_mesh(vessel.closed), process=False).is_volume


@pytest.mark.parametrize('name', PATTERNS)
def test_patterns_are_periodic_reflectances(name):
    texture = PATTERNS[name](np.random.default_rng(4))
    assert texture.shape == (SIZE, SIZE, 3)
    assert texture.dtype == np.float32
    assert texture.min() >= 0
    assert texture.max() <= 1
    if name in ('clouds', 'grain', 'plain', 'panes'):
        seam = np.abs(texture[:, 0] - texture[:, -1]).mean()
        assert seam < 1.5 * np.abs(np.diff(texture, axis=1)).mean(axis=(0, 2)).max()


def test_a_room_shades_as_its_light_is_gathered():
    rng = np.random.default_rng(6)
    room = random_environment(rng)
    turn = Rotation.random(None, rng).as_matrix()
    coefficients = room.irradiance(turn.T)
    ways = rng.standard_normal((20000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    light = np.array([look_up(room.panorama, *each) for each in ways])
    for normal in np.eye(3):
        cosine = np.clip(ways @ (turn @ normal), 0, None)
        gathered = 4 * (cosine[:, None] * light).mean(axis=0)  # 4 pi / pi
        assert shade(coefficients, *normal) == pytest.approx(gathered, rel=0.15)
    plain = Environment(np.full((32, 64, 3), 0.6, np.float32)).irradiance(np.eye(3))
    assert shade(plain, 0.6, 0, 0.8) == pytest.approx((0.6, 0.6, 0.6), rel=1e-3)


def test_a_panorama_has_its_top_up():
    rows = np.zeros((64, 128, 3), np.float32)
    rows[:32] = 1
    rows[32:, 96:] = (0, 1, 0)
    assert look_up(rows, 0.1, 0.1, 0.98) == pytest.approx((1, 1, 1))
    # Columns run from -x by -y and +x to +y: the last quarter lies between +y and -x.
    assert look_up(rows, -0.7, 0.6, -0.3) == pytest.approx((0, 1, 0))
    assert look_up(rows, 0.7, -0.6, -0.3) == pytest.approx((0, 0, 0))


def test_outer_views_are_darker_and_nearer_the_axis():
    positions, weights = pupil_views(9, 4.2)
    assert weights[4, 4] == pytest.approx(1)
    assert positions[4, 4] == pytest.approx([0, 0], abs=1e-9)
    assert positions[4, 6] == pytest.approx([2, 0], abs=0.05)
    assert (np.diff(weights[4, 4:]) <= 1e-6).all()
    assert 2.7 < positions[4, 7, 0] < 3
    assert 3.2 < positions[4, 8, 0] < 3.7
    assert weights[0, 0] == 0
    assert np.allclose(positions, -positions[::-1, ::-1])
    assert np.allclose(weights, weights.T)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10 ** 6), st.floats(0.2, 2), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_a_camera_sees_what_it_is_aimed_at(seed, distance, right, down):
    rng = np.random.default_rng(seed)
    aim = rng.uniform(-0.1, 0.1, 3)
    camera = camera_above(rng, aim, distance, (right, 0.0))
    seen = camera[:3, :3] @ aim + camera[:3, 3]
    assert np.linalg.norm(seen) == pytest.approx(distance)
    assert np.arctan2(seen[0], seen[2]) == pytest.approx(right, abs=1e-9)
    seen = (camera_above(rng, aim, distance, (0.0, down)) @ np.append(aim, 1))[:3]
    assert np.arctan2(seen[1], seen[2]) == pytest.approx(down, abs=1e-9)
    assert np.linalg.det(camera[:3, :3]) == pytest.approx(1)
    assert camera[1, 2] < 0.3  # up in the world is up in the picture, mostly
    assert camera[2, 2] < 0.4  # looking down, but for a little


@pytest.mark.parametrize('way', ['upright', 'lying', 'head down'])
def test_things_rest_on_the_table(way):
    rng = np.random.default_rng(0)
    vertices = rng.uniform(-0.05, 0.05, (100, 3))
    pose = resting(rng, vertices, way)
    low = (vertices @ pose[2, :3] + pose[2, 3]).min()
    assert low == pytest.approx(0, abs=1e-12)
    up = {'upright': 1, 'lying': 0, 'head down': -1}[way]
    assert pose[2, 2] == pytest.approx(up, abs=0.2)


def test_settings_refuse_views_without_a_centre():
    with pytest.raises(SettingsError, match='odd'):
        SceneSettings.make({'views': 4})


def test_arrays_of_a_scene_are_contiguous_whatever_its_textures():
    """Else the kernels would be compiled once more, for other strides."""
    plain = np.broadcast_to(np.float32([0.6, 0.1, 0.1]), (SIZE, SIZE, 3))
    for textures in ([plain], [plain, plain.copy()], [plain.copy().swapaxes(0, 1)]):
        world = World.from_scene(plain_scene(sheets=[
            Sheet(pose_at(0, 0, 0.5), (0.1, 0.1), each, 0.1) for each in textures]))
        assert len(world.textures) == len(textures)
        for array in world:
            assert array.flags.c_contiguous
