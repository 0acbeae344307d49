"""Rooms with lamps: shadows fall where geometry says, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from plain_scenes import WHITE, plain_scene, plain_sensor, pose_at

from pmcl_ros.simulation.scenes.broad_scene import broad_scene
from pmcl_ros.simulation.scenes.environment import Environment, random_lit_environment
from pmcl_ros.simulation.scenes.materials import Clear, Opaque
from pmcl_ros.simulation.scenes.random_scene import KINDS, SceneSettings
from pmcl_ros.simulation.scenes.render import light_of_view
from pmcl_ros.simulation.scenes.scene import Decal, Sheet, Solid
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.textures import MORE, SIZE
from pmcl_ros.simulation.scenes.world import World

# The camera looks along z onto a white sheet 0.5 m away; the panorama's up is against it, so the
# lamp is behind the camera, aside by 45 degrees towards +x.
_WORLD_FROM_CAMERA = np.diag([1.0, -1.0, -1.0])
_SHEET = Sheet(pose_at(0, 0, 0.5), (4.0, 4.0), WHITE, 0.1)
_ROWS = 64


def _room(lamp_radiance=400.0, ambient=0.2):
    unlit = np.full((_ROWS, 2 * _ROWS, 3), ambient, np.float32)
    polar, azimuth, size = np.pi / 4, 0.0, np.pi / _ROWS
    lamp = [polar - size, polar + size, azimuth - size, 2 * size, *[lamp_radiance] * 3]
    return Environment(unlit, np.array([lamp]), unlit)


def _light(solids, sheets=(_SHEET,), room=None, size=80, samples=4, focus=100.0, seed=0):
    sensor = plain_sensor(size=size, fx=size * 2.0, baseline=1e-6)
    scene = replace(plain_scene(solids, sheets, sensor=sensor), environment=room or _room(),
                    world_from_camera=_WORLD_FROM_CAMERA)
    return light_of_view(World.from_scene(scene), sensor, 1, 1, 0, samples, seed)


def _ball(z, medium, radius=0.02, x=0.0, decal=None):
    turn = np.linspace(-np.pi / 2, np.pi / 2, 60)
    profile = radius * np.stack([np.abs(np.cos(turn)), np.sin(turn)], axis=1)
    return Solid(Frusta.from_profile(profile, 0, 1), (medium,), pose_at(x, 0, z), decal)


def test_a_white_plane_has_the_light_of_lamp_and_room():
    room = _room()
    polar, size = np.pi / 4, np.pi / _ROWS
    solid_angle = (np.cos(polar - size) - np.cos(polar + size)) * 2 * size
    expected = 0.2 + 400 * solid_angle * np.cos(polar) / np.pi
    assert _light([], room=room).mean() == pytest.approx(expected, rel=0.01)
    assert _light([], room=room).std() < 1e-3 * expected


def test_the_shadow_lies_where_the_lamp_is_hidden():
    ball = _ball(0.44, Opaque(WHITE), radius=0.01)
    light = _light([ball]).mean(axis=2)
    bare = _light([]).mean(axis=2)
    # The lamp is towards +x, so the shadow of a ball 0.06 m above the sheet is 0.06 m to -x.
    centre, scale = 39.5, 160 / 0.5
    x, y = -0.06 * scale + centre, centre
    assert light[int(y), int(x)] < 0.6 * bare.mean()
    yy, xx = np.mgrid[:80, :80]
    shadow = light < 0.8 * bare
    outside_ball = np.hypot(xx - centre, yy - centre) > 6
    dark = shadow & outside_ball
    assert np.hypot(xx[dark].mean() - x, yy[dark].mean() - y) < 1.0
    far = np.hypot(xx - x, yy - y) > 12
    assert light[far & outside_ball & (yy > 60)] == pytest.approx(bare.mean(), rel=0.05)


def test_glass_throws_a_fainter_shadow_with_a_darker_rim():
    opaque, glass = (_light([_ball(0.44, medium, radius=0.012)]).mean(axis=2)
                     for medium in (Opaque(WHITE), Clear(1.5)))
    bare = float(_light([]).mean())
    x, y = int(39.5 - 0.06 * 320), 40
    middle = glass[y - 1:y + 2, x - 1:x + 2].mean()
    rim = glass[y - 5:y - 2, x - 1:x + 2].mean()
    assert opaque[y - 1:y + 2, x - 1:x + 2].mean() < 0.5 * middle
    assert rim < 0.8 * middle
    assert middle < 1.05 * bare


def test_contact_darkens_the_table_without_any_lamp_in_view():
    box = trimesh.creation.box([0.05, 0.05, 0.05])
    solid = Solid(Triangles(np.array(box.triangles), 0, 1), (Opaque(WHITE),),
                  pose_at(0, 0, 0.475))
    room = _room(lamp_radiance=1e-3)
    light = _light([solid], room=room, samples=16).mean(axis=2)
    row = light[38:42].mean(axis=0)
    edge = 39.5 + 0.025 * 160 / 0.45
    near, far = row[int(edge) + 3], row[-3:].mean()
    assert near < 0.8 * far
    assert far == pytest.approx(0.2, rel=0.1)


def test_rough_glass_blurs_what_is_behind():
    stripes = np.where((np.arange(SIZE) // 48 % 2)[None, :, None], 1.0, 0.05)
    stripes = np.tile(stripes, (SIZE, 1, 3)).astype(np.float32)
    slab = trimesh.creation.box([1.0, 1.0, 0.01])

    def contrast(roughness):
        glass = Clear(1.5, roughness=roughness)
        solid = Solid(Triangles(np.array(slab.triangles), 0, 1), (glass,), pose_at(0, 0, 0.4))
        sheet = replace(_SHEET, texture=stripes, side=0.2)
        return _light([solid], [sheet], samples=2).mean(axis=(0, 2)).std()

    sharp = contrast(0.0)
    assert sharp > 0.15
    assert contrast(0.3) < 0.4 * sharp


def test_a_translucent_sheet_scatters():
    stripes = np.where((np.arange(SIZE) // 48 % 2)[None, :, None], 1.0, 0.05)
    stripes = np.tile(stripes, (SIZE, 1, 3)).astype(np.float32)

    def contrast(roughness):
        film = Sheet(pose_at(0, 0, 0.3), (4.0, 4.0), WHITE, 0.1, 0.2, 1.0, roughness)
        sheet = replace(_SHEET, texture=stripes, side=0.2)
        return _light([], [film, sheet], samples=8).mean(axis=(0, 2)).std()

    assert contrast(0.1) < 0.4 * contrast(0.0)


def test_a_label_covers_its_heights_only():
    black = np.zeros((SIZE, SIZE, 3), np.float32)
    label = Decal((-0.03, -0.02), (-np.pi, np.pi), black, 0.1)  # z runs away from the camera
    bare, labelled, none = (_light([_ball(0.3, Clear(1.5), radius=0.03, decal=decal)], size=120)
                            for decal in (None, label, replace(label, opacity=0.0)))
    y, x = np.mgrid[:120, :120]
    away = np.hypot(x - 59.5, y - 59.5)
    edge = 240 * np.sqrt(0.03 ** 2 - 0.02 ** 2) / (0.3 - 0.02)
    dark = (labelled < 0.3 * bare).all(axis=2)  # its reflections remain
    assert dark[(away > 2) & (away < edge - 1.5)].mean() > 0.99
    assert not dark[away > edge + 1.5].any()
    assert np.array_equal(labelled[:20], bare[:20])
    assert np.array_equal(none, bare)


def test_stains_cover_where_the_texture_is_bright():
    half = np.zeros((SIZE, SIZE, 3), np.float32)
    half[:, :SIZE // 2] = 1
    stain = Decal((-1, 1), (-np.pi, np.pi), half, 0.05, 1.0, 0.5)
    bare, stained = (_light([_ball(0.3, Clear(1.5), radius=0.03, decal=decal)], size=60)
                     for decal in (None, stain))
    changed = np.abs(stained - bare).max(axis=2) > 0.02
    assert 0.02 < changed.mean() < 0.6


def test_a_glossy_table_mirrors():
    ball = _ball(0.3, Opaque(np.zeros_like(WHITE)), radius=0.05, x=0.3)
    flat = _light([ball])
    glossy = _light([ball], [replace(_SHEET, texture=WHITE * 0.2, coat=1.6)])
    assert glossy.mean() < flat.mean()
    mirror = _light([], [replace(_SHEET, texture=WHITE * 0, coat=1.6)])
    share = ((1.6 - 1) / (1.6 + 1)) ** 2
    assert mirror[40, 40] == pytest.approx(share * 0.2, rel=0.05)


@pytest.mark.parametrize('seed', range(6))
def test_lamps_are_in_the_panorama_and_above_the_table(seed):
    room = random_lit_environment(np.random.default_rng(seed))
    rows = room.panorama.shape[0]
    assert room.unlit is not None
    painted = np.zeros(room.panorama.shape[:2], bool)
    for low, high, start, width, *_ in room.lamps:
        assert 0 <= low < high < np.pi / 2
        rows_of = slice(round(low / np.pi * rows), round(high / np.pi * rows))
        columns = np.arange(round(width / np.pi * rows))
        columns += round((start + np.pi) / np.pi * rows)
        painted[rows_of, columns % (2 * rows)] = True
    assert (room.panorama == room.unlit)[~painted].all()
    assert (room.panorama != room.unlit)[painted].any()
    above = room.panorama.mean(axis=2)[painted].mean()
    assert above > room.unlit.mean()


@pytest.mark.parametrize('seed', range(4))
def test_broad_scenes_are_the_same_for_a_seed_and_of_every_kind(seed):
    settings = SceneSettings(views=3, size=32, clutter=4, kinds=KINDS[seed::4], empty=0)
    one, two = (broad_scene(np.random.default_rng(seed), settings) for _ in range(2))
    assert one.name == two.name
    assert len(one.environment.lamps) > 0
    worlds = [World.from_scene(each) for each in (one, two)]
    for a, b in zip(*worlds, strict=True):
        assert np.array_equal(a, b)
    assert len(one.owners) == len(one.solids)
    assert one.owners[0] == 0
    light = light_of_view(worlds[0], one.sensor, 1, 1, 0, 1, 5)
    assert np.isfinite(light).all()
    assert light.min() >= 0
    assert np.array_equal(light, light_of_view(worlds[1], one.sensor, 1, 1, 0, 1, 5))


@pytest.mark.parametrize('name', MORE)
def test_textures_are_reflectances(name):
    texture = MORE[name](np.random.default_rng(1))
    assert texture.shape == (SIZE, SIZE, 3)
    assert texture.dtype == np.float32
    assert 0 <= texture.min() < texture.max() <= 1
