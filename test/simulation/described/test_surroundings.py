"""Scenes of a described object: it is where its pose says, and media nest around it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
import yaml

from pmcl_ros.runtime.errors import SimulationError
from pmcl_ros.simulation.camera_plan import CameraPlan, without_walls_between
from pmcl_ros.simulation.described.object_description import load_object
from pmcl_ros.simulation.described.substances import WATER
from pmcl_ros.simulation.described.surroundings import (
    SURROUNDINGS,
    DescribedSettings,
    described_scene,
)
from pmcl_ros.simulation.described.water import standing_in_water, submerged, water_surface
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_picture
from pmcl_ros.simulation.scenes.environment import random_lit_environment
from pmcl_ros.simulation.scenes.objects import SceneObject
from pmcl_ros.simulation.scenes.render import fast, first_surfaces
from pmcl_ros.simulation.scenes.scene import Scene
from pmcl_ros.simulation.scenes.shapes.vessels import outer_mesh
from pmcl_ros.simulation.scenes.trace import nearest
from pmcl_ros.simulation.scenes.world import World

HEIGHT = 0.09
TUMBLER = np.array([[0, 0], [0.028, 0], [0.03, 0.002], [0.036, HEIGHT], [0, HEIGHT]])
GLASS = {'material': 'glass', 'wall': 0.0025, 'mouth': {'z': HEIGHT}}
CAMERA = OrdinaryCamera(width=48, height=36, fx=60.0, cx=23.5, cy=17.5)
UPRIGHT = DescribedSettings(attitude='upright', empty=0)


@pytest.fixture
def describe(tmp_path):
    """Writes the YAML file of a tumbler or a box, and loads it."""
    def load(kind='tumbler', **appearance):
        mesh = (trimesh.Trimesh(*outer_mesh(TUMBLER), process=False) if kind == 'tumbler' else
                trimesh.creation.box(bounds=[[-0.03, -0.02, 0], [0.03, 0.02, HEIGHT]]))
        mesh.export(tmp_path / 'thing.stl')
        path = tmp_path / 'thing.yaml'
        path.write_text(yaml.safe_dump({'mesh': 'thing.stl', 'appearance': GLASS | appearance}))
        return load_object(path)
    return load


def _sensor(seed=0):
    return CAMERA.sensor(np.random.default_rng(seed))


def _of_solids(solids):
    rng = np.random.default_rng(0)
    return Scene('', tuple(solids), (), random_lit_environment(rng), np.eye(3), _sensor(), (), ())


def _breaks(scene, starts, ends):
    """(share of surfaces on straight rays where the medium before is not the last one's behind,
    number of surfaces). Rays (n, 3) to (n, 3) begin in air and end at what is opaque.
    """
    world = World.from_scene(scene)
    hit, stack = np.zeros(9), np.zeros(64, np.int64)
    broken = met = 0
    for at, end in zip(starts, ends, strict=True):
        way, medium = (end - at) / np.linalg.norm(end - at), world.materials[0, :5]
        for _ in range(30):
            kind, t, number, outside, inside = nearest(world, hit, stack, *at, *way)
            at = at + t * way
            if kind == 0 or (kind == 2 and world.sheets[number, 16] >= 1):
                break
            if kind == 2:  # a film
                continue
            leaves = hit[3:6] @ way > 0
            before, behind = (inside, outside) if leaves else (outside, inside)
            met += 1
            broken += not np.array_equal(world.materials[before, :5], medium)
            medium = world.materials[behind, :5]
            if medium[0] == 0:
                break
    return broken / met, met


@pytest.mark.parametrize('kind', ['tumbler', 'box'])
@pytest.mark.parametrize('mouth', [{'z': HEIGHT}, {'open': False}])
@pytest.mark.parametrize('liquid', [None, {'level': 0.05}])
def test_media_nest_in_an_object(describe, kind, mouth, liquid):
    thing = describe(kind, mouth=mouth, liquid=liquid)
    points = np.random.default_rng(1).uniform([-0.04, -0.04, 0], [0.04, 0.04, HEIGHT], (300, 3))
    ways = np.random.default_rng(2).standard_normal((300, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    block = SceneObject.from_mesh(trimesh.creation.box((0.3, 0.3, 0.3)), WATER).solids
    wet = (*block, *(submerged(each) for each in thing.solids))
    for solids in (thing.solids, wet):
        share, met = _breaks(_of_solids(solids), points - ways, points)
        assert met > 600
        assert share < 0.003


def _hidden(scene, cameras):
    """(n,) whether cameras (n, 4, 4) see a sheet first in the direction of the object."""
    world = World.from_scene(scene)
    hit, stack = np.zeros(9), np.zeros(64, np.int64)
    target, = scene.targets
    middle = target.pose[:3, :3] @ target.vertices.mean(axis=0) + target.pose[:3, 3]
    eyes = cameras[:, :3, 3]
    ways = (middle - eyes) / np.linalg.norm(middle - eyes, axis=1, keepdims=True)
    return np.array([nearest(world, hit, stack, *eye, *way)[0] == 2
                     for eye, way in zip(eyes, ways, strict=True)])


def test_no_wall_is_between_the_object_and_a_camera(describe):
    thing, hidden = describe(), 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        scene = described_scene(rng, thing, 'table', CAMERA.sensor(rng), UPRIGHT)
        narrow, wide = (CameraPlan.parse(each).cameras(scene)
                        for each in ('arc:5:60', 'arc:9:300'))
        assert without_walls_between(scene, narrow).sheets == scene.sheets
        shown = without_walls_between(scene, wide)
        assert not _hidden(shown, wide).any()
        assert len(scene.sheets) - len(shown.sheets) == _hidden(scene, wide).any()
        hidden += _hidden(scene, wide).sum()
    assert hidden > 3


@pytest.mark.parametrize('seed', [12, 75, 77, 79])  # the first drawn has a counter before it
def test_a_counter_does_not_hide_the_object(describe, seed):
    rng = np.random.default_rng(seed)
    scene = described_scene(rng, describe(), 'sink', CAMERA.sensor(rng), UPRIGHT)
    assert not _hidden(scene, np.eye(4)[None]).any()


def test_water_stands_around_a_vessel_but_not_in_it(describe):
    dry, = describe().solids
    wet, radius = standing_in_water(dry, 0.04)
    assert radius == pytest.approx(np.interp(0.04, [0.002, HEIGHT], [0.03, 0.036]), abs=1e-6)
    rings, media = wet.surface.rings, wet.surface.media
    outside = rings[media[:, 0] == len(wet.media)]
    assert outside[:, [1, 3]].max() == pytest.approx(0.04)
    assert outside[:, 0].max() <= radius + 1e-9
    # The same surface, but for the media.
    r0, z0, r1, z1 = rings[:, :4].T
    area = ((r0 + r1) * np.hypot(r1 - r0, z1 - z0)).sum()
    r0, z0, r1, z1 = dry.surface.rings[:, :4].T
    assert area == pytest.approx(((r0 + r1) * np.hypot(r1 - r0, z1 - z0)).sum(), rel=1e-9)
    surface = water_surface(np.random.default_rng(0), [-0.2, -0.1], [0.15, 0.2], 0.04, 0.05,
                            radius)
    starts, ends = np.random.default_rng(3).uniform(-0.05, 0.05, (2, 300, 3))
    starts[:, 2], ends[:, 2] = 0.3, 0  # down into the water, and no wave is met twice
    share, met = _breaks(_of_solids([wet, surface]), starts, ends)
    assert met > 500
    assert share < 0.003


def test_a_water_surface_fills_its_basin_with_waves_of_its_slope():
    low, high, hole = np.array([-0.2, -0.1]), np.array([0.15, 0.2]), 0.04
    surface = water_surface(np.random.default_rng(0), low, high, 0.03, 0.05, hole)
    corners = surface.surface.corners
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    assert (across[:, 2] > 0).all()
    assert across[:, 2].sum() == pytest.approx(
        np.prod(high - low) - np.pi * hole ** 2, rel=2e-3)
    slope = np.hypot(across[:, 0], across[:, 1]) / across[:, 2]
    assert np.sqrt(np.average(slope ** 2, weights=across[:, 2])) == pytest.approx(0.05, rel=0.25)
    edge = corners[np.hypot(corners[..., 0], corners[..., 1]) < hole + 1e-6]
    assert edge[:, 2] == pytest.approx(0.03)


@pytest.mark.parametrize('surroundings', SURROUNDINGS)
def test_an_object_is_seen_where_its_pose_says(describe, surroundings):
    thing = describe(material='tinted')
    sensor = _sensor()
    scene = described_scene(np.random.default_rng(4), thing, surroundings, sensor, UPRIGHT)
    target, = scene.targets
    assert scene.sensor is sensor
    assert len(scene.environment.lamps)
    assert scene.name == f'{surroundings}: tinted thing'
    assert len(scene.owners) == len(scene.solids)
    for solid, owner in zip(scene.solids, scene.owners, strict=True):
        if owner == 0:
            np.testing.assert_allclose(solid.pose, target.pose, atol=1e-12)
    middle = target.pose[:3, :3] @ [0, 0, HEIGHT / 2] + target.pose[:3, 3]
    if surroundings != 'random':
        assert 0.4 - 1e-9 <= np.linalg.norm(middle) <= 0.75 + 1e-9
        up = scene.world_from_camera @ target.pose[:3, 2]
        assert up == pytest.approx([0, 0, 1], abs=1e-9)
    off = np.abs(np.array(target.roi_center) - target.pose[:3, 3])
    assert (off <= np.array(target.roi_size) / 2).all()
    gone = replace(scene, solids=tuple(
        each for each, owner in zip(scene.solids, scene.owners, strict=True) if owner))
    seen, unseen = (take_picture(each, CAMERA, np.random.default_rng(0), 4).astype(int)
                    for each in (scene, gone))
    assert seen.shape == (36, 48, 3)
    assert np.abs(seen - unseen).max() > 20
    again = described_scene(np.random.default_rng(4), thing, surroundings, sensor, UPRIGHT)
    np.testing.assert_array_equal(seen, take_picture(again, CAMERA, np.random.default_rng(0), 4))


def _light(scene, solids=None, sheets=None):
    """(36, 48, 3) without noise; of these numbers of solids, and these sheets, alone."""
    solids = range(len(scene.solids)) if solids is None else solids
    shown = replace(scene, solids=tuple(scene.solids[k] for k in solids),
                    owners=tuple(scene.owners[k] for k in solids),
                    sheets=scene.sheets if sheets is None else sheets)
    return fast(shown)(scene.sensor, 0, 0, 0, 4, 1)


@pytest.mark.parametrize('seed', [30, 36])  # the jet is in view
def test_running_water_is_in_the_picture(describe, seed):
    """Where the jet's surface is the first; elsewhere little changes, as by what is mirrored."""
    scene = described_scene(np.random.default_rng(seed), describe(), 'sink', _sensor(), UPRIGHT)
    numbers = np.arange(len(scene.solids))
    jet = len(numbers) - 3  # before the spout and its arm
    assert scene.solids[jet].media == (WATER,)
    jets = first_surfaces(World.from_scene(scene), CAMERA.pinhole, numbers)[0] == jet
    assert jets.sum() > 20
    whole = _light(scene)
    changed = np.abs(whole - _light(scene, np.delete(numbers, jet))).mean(axis=2) / whole.mean()
    assert (changed[jets] > 0.01).mean() > 0.95
    assert changed[jets].mean() > 3 * changed[~jets].mean()


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_a_film_is_in_the_picture(describe, seed):
    """Where it is between the camera and the tank; elsewhere little changes."""
    scene = described_scene(np.random.default_rng(seed), describe(), 'tank', _sensor(), UPRIGHT)
    film, = (each for each in scene.sheets if each.opacity < 1)
    rest = tuple(each for each in scene.sheets if each is not film)
    corners = np.array([[x, y, 0, 1] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], float)
    corners[:, :2] *= np.array(film.size) / 2
    outline = CAMERA.pinhole.project((corners @ film.pose.T)[:, :3])
    covered = cv2.fillConvexPoly(np.zeros((36, 48), np.uint8),
                                 np.rint(outline).astype(np.int32), 1)
    whole = _light(scene)
    changed = np.abs(whole - _light(scene, sheets=rest)).mean(axis=2) / whole.mean()
    inside = cv2.erode(covered, np.ones((3, 3))) > 0
    outside = cv2.dilate(covered, np.ones((3, 3))) == 0
    assert (changed[inside] > 0.01).mean() > 0.99
    assert changed[inside].mean() > 3 * changed[outside].mean()


@pytest.mark.parametrize(('surroundings', 'attitude'), [
    ('shelf', 'any'), ('sink', 'upright'), ('sink', 'lying'), ('tank', 'lying')])
def test_media_nest_as_the_camera_sees_them(describe, surroundings, attitude):
    scene = described_scene(np.random.default_rng(0), describe(), surroundings, _sensor(),
                            DescribedSettings(attitude=attitude, empty=0, outside=0))
    target, = scene.targets
    points = np.random.default_rng(0).uniform([-0.05, -0.05, -0.01], [0.05, 0.05, 0.1], (100, 3))
    ends = points @ target.pose[:3, :3].T + target.pose[:3, 3]
    share, met = _breaks(scene, np.zeros_like(ends), ends)
    assert met > 50
    assert share < 0.02  # a jet ends on the water


def test_an_empty_scene_still_has_its_target(describe):
    settings = DescribedSettings(empty=1)
    for surroundings in ('table', 'sink', 'random'):
        scene = described_scene(np.random.default_rng(0), describe(), surroundings, _sensor(),
                                settings)
        assert scene.targets[0].empty
        assert 0 not in scene.owners


def test_what_holds_a_liquid_stands_upright(describe):
    full = describe(liquid={'level': 0.05})
    with pytest.raises(SimulationError, match='attitude: upright'):
        described_scene(np.random.default_rng(0), full, 'table', _sensor(),
                        DescribedSettings(attitude='lying'))
    scene = described_scene(np.random.default_rng(0), full, 'sink', _sensor(),
                            DescribedSettings(empty=0))
    assert scene.world_from_camera @ scene.targets[0].pose[:3, 2] == pytest.approx([0, 0, 1])


@pytest.mark.parametrize('middle', [(23.5, 17.5), (5.0, 30.0), (47.0, 2.0)])
def test_the_object_is_in_the_picture_wherever_the_optical_axis_is(describe, middle):
    camera = CAMERA.model_copy(update={'cx': middle[0], 'cy': middle[1]})
    thing, places = describe(), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        scene = described_scene(rng, thing, 'table', camera.sensor(rng), UPRIGHT)
        pose = scene.targets[0].pose
        at = pose[:3, :3] @ [0, 0, HEIGHT / 2] + pose[:3, 3]
        places.append(scene.sensor.grid.pinhole.project(at[None])[0])
    offsets = np.array(places) - [23.5, 17.5]
    assert (abs(offsets) < [24, 18]).all()
    assert abs(offsets.mean(axis=0)).max() < 6


def test_the_wall_of_a_sink_is_behind_it(describe):
    thing = describe()
    for seed in range(40):
        scene = described_scene(np.random.default_rng(seed), thing, 'sink', _sensor(seed), UPRIGHT)
        world, hit, stack = World.from_scene(scene), np.zeros(9), np.zeros(64, np.int64)
        pose = scene.targets[0].pose
        met = [nearest(world, hit, stack, 0, 0, 0, *end / np.linalg.norm(end))
               for end in thing.vertices[::7] @ pose[:3, :3].T + pose[:3, 3]]
        walls = [number == len(scene.sheets) - 1 for kind, _, number, *_ in met if kind == 2]
        assert not any(walls), seed
