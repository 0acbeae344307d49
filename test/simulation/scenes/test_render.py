"""What is rendered agrees with the geometry that the rest of the package assumes."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from plain_scenes import WHITE, plain_scene, plain_sensor, pose_at
from scipy.ndimage import binary_dilation, binary_erosion
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.drawing.pictures import silhouette
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.runtime.kernel_threads import set_threads
from pmcl_ros.simulation.scenes.materials import Clear, Opaque
from pmcl_ros.simulation.scenes.objects import SceneObject, random_opaque, random_transparent
from pmcl_ros.simulation.scenes.random_scene import KINDS, SceneSettings, random_scene
from pmcl_ros.simulation.scenes.render import first_surfaces, render
from pmcl_ros.simulation.scenes.scene import Sheet, Solid, Target
from pmcl_ros.simulation.scenes.sensor import noisy
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.textures import clouds
from pmcl_ros.simulation.scenes.world import World

_SMALL = SceneSettings(views=3, size=48, clutter=3)


def _target(thing, pose):
    return Target(thing.vertices, thing.faces, thing.axis, pose, (0, 0, 0.5), (0.1,) * 3, False)


@pytest.mark.parametrize('depth', [0.4, 0.7])
def test_a_plane_has_the_disparity_of_its_depth(depth):
    rng = np.random.default_rng(2)
    sensor = plain_sensor(size=96, views=5, fx=900.0, blur=1.0, focus=0.55)
    sheet = Sheet(pose_at(0, 0, depth), (1.0, 1.0), clouds(rng), 0.15)
    capture = render(plain_scene(sheets=[sheet], sensor=sensor), rng)
    settings = DlvSettings(near=0.3, far=1.0, labels=60, views=5)
    volume = build_volume(capture.light_field, settings)
    step = np.diff(1 / volume.depths).mean()
    found = 1 / volume.depth_map()[12:-12, 12:-12]
    assert abs(np.nanmedian(found) - 1 / depth) < step / 2
    assert (capture.labels == -1).all()


@pytest.mark.parametrize('seed', range(3))
def test_silhouettes_are_those_of_the_outer_mesh(seed):
    rng = np.random.default_rng(seed)
    thing = (random_transparent if seed % 2 else random_opaque)(rng)
    pose = pose_of(Rotation.random(None, rng), rng.uniform([-0.02, -0.02, 0.4], [0.02, 0.02, 0.6]))
    sensor = plain_sensor(size=160, views=3, fx=450.0)
    solids = thing.placed(pose)
    scene = plain_scene(solids, sensor=sensor, targets=[_target(thing, pose)],
                        owners=[0] * len(solids))
    sensor = replace(sensor, grid=replace(sensor.grid, weights=np.eye(3, dtype=np.float32)))
    capture = render(replace(scene, sensor=sensor), rng, 1)
    drawn = silhouette(sensor.grid.pinhole, capture.model(), pose)
    mesh = trimesh.Trimesh(thing.vertices, thing.faces, process=False)
    solid = SceneObject.from_mesh(mesh, Clear(1.5)).placed(pose)
    seen = capture.labels == 0
    world = World.from_scene(plain_scene(solid))
    _, depth = first_surfaces(world, sensor.grid.pinhole, np.zeros(1, int))
    assert drawn.sum() > 1000
    around = np.ones((3, 3))
    assert (seen <= binary_dilation(drawn, around)).all()
    assert (binary_erosion(drawn, around) <= seen).all()
    # Open vessels are seen into; what is not opening has the mesh's depth.
    both = seen & drawn & (np.abs(capture.depth - depth) < 1e-3)
    assert both.sum() > 0.4 * drawn.sum()
    assert capture.depth[~seen].max(initial=0) == 0
    assert (binary_erosion(drawn, around) <= (depth > 0)).all()
    assert ((depth > 0) <= binary_dilation(drawn, around)).all()


def test_a_pixel_is_as_noisy_as_asked():
    rng = np.random.default_rng(0)
    sensor = replace(plain_sensor(), shot=8e-4, read=0.004, gains=(0.8, 1.0, 0.5))
    for weight in (1.0, 0.5):
        values = noisy(np.full((400, 400, 3), 0.4, np.float32), weight, sensor, rng)
        expected = 0.4 * np.array(sensor.gains)
        variance = (8e-4 * expected + 0.004 ** 2) * [2, 1, 2] / weight
        assert values.mean(axis=(0, 1)) == pytest.approx(expected, abs=2e-3)
        assert values.var(axis=(0, 1)) == pytest.approx(variance, rel=0.03)
    green = values[..., 1] - values[..., 1].mean()
    assert (green[:, 1:] * green[:, :-1]).mean() / green.var() == pytest.approx(0.165, abs=0.02)
    assert abs((green[:, 2:] * green[:, :-2]).mean() / green.var()) < 0.03
    assert not noisy(np.ones((4, 4, 3), np.float32), 0.0, sensor, rng).any()


def test_the_same_seed_gives_the_same_picture_on_any_number_of_threads(all_threads):
    pictures = []
    for number, seed in ((all_threads, 4), (1, 4), (all_threads, 5)):
        set_threads(number)
        rng = np.random.default_rng(seed)
        pictures.append(render(random_scene(rng, _SMALL), rng, 1).light_field.views)
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])


@pytest.mark.parametrize('kind', KINDS)
def test_every_kind_of_scene_is_a_light_field(kind):
    rng = np.random.default_rng(11)
    settings = SceneSettings(views=5, size=40, kinds=(kind,), empty=0, targets=2)
    scene = random_scene(rng, settings)
    parts = []
    capture = render(scene, rng, 1, parts.append)
    assert parts[-1] == 1
    assert parts == sorted(parts)
    assert capture.light_field.views.shape == (5, 5, 40, 40, 3)
    assert 0.05 < capture.light_field.centre_view.mean() < 0.6
    assert any(sheet.opacity < 1 for sheet in scene.sheets) == kind.endswith('film')
    for number, target in enumerate(scene.targets):
        model = capture.model(number)
        assert model.closed
        assert (abs(target.pose[:3, 3] - target.roi_center) <= np.array(target.roi_size) / 2).all()
        assert settings.near * 0.6 < target.pose[2, 3] < settings.far * 1.4
        # It stands on the table, the first sheet, or above it.
        table = scene.sheets[0].pose
        points = target.vertices @ target.pose[:3, :3].T + target.pose[:3, 3]
        assert ((points - table[:3, 3]) @ table[:3, 2]).min() > -1e-9


def test_a_noise_free_view_without_objects_is_that_of_a_crop():
    rng = np.random.default_rng(3)
    scene = random_scene(rng, SceneSettings(views=3, size=64, noise=0, empty=0, clutter=0))
    sensor = replace(scene.sensor, blur=0.0, level=1e-3)
    grid = sensor.grid
    part = replace(grid, pinhole=grid.pinhole.crop(20, 10, 30, 40))
    whole = render(replace(scene, sensor=sensor), np.random.default_rng(0), 1)
    cut = render(replace(scene, sensor=replace(sensor, grid=part)), np.random.default_rng(0), 1)
    assert np.array_equal(whole.labels[10:50, 20:50], cut.labels)
    assert np.allclose(whole.depth[10:50, 20:50], cut.depth, atol=1e-6)


def test_a_mesh_of_glass_bends_what_an_opaque_one_hides():
    mesh = trimesh.creation.box((0.04, 0.05, 0.03))
    rng = np.random.default_rng(1)
    sheet = Sheet(pose_at(0, 0, 0.8), (2.0, 2.0), clouds(rng), 0.3)
    pose = pose_of(Rotation.from_euler('xyz', [0.4, 0.5, 0.1]), np.array([0, 0, 0.5]))
    views = {}
    for name, medium in (('air', Clear()), ('glass', Clear(1.5)), ('opaque', Opaque(0 * WHITE))):
        thing = SceneObject.from_mesh(mesh, medium)
        scene = plain_scene(thing.placed(pose), [sheet], light=0.5,
                            targets=[_target(thing, pose)], owners=[0])
        capture = render(scene, np.random.default_rng(0), 1)
        inside = binary_erosion(capture.labels == 0, iterations=2)
        view = capture.light_field.centre_view
        views[name] = view / view[:8].mean()  # apart from the exposure
    assert inside.sum() > 100
    assert views['opaque'][inside].max() == 0
    empty = render(plain_scene(sheets=[sheet], light=0.5), np.random.default_rng(0), 1)
    view = empty.light_field.centre_view
    assert np.allclose(views['air'], view / view[:8].mean(), atol=1e-5)
    assert np.abs(views['glass'] - views['air'])[inside].mean() > 0.02
    assert views['glass'][inside].mean() == pytest.approx(views['air'][inside].mean(), rel=0.3)


@pytest.mark.parametrize('blur', [0.0, 1.0])
def test_a_ball_covers_the_area_that_it_should(blur):
    """Contours lie where they are to a fiftieth of a pixel, and the blur does not move them."""
    rng = np.random.default_rng(0)
    radius, depth = 0.03, 0.5
    turn = np.linspace(-np.pi / 2, np.pi / 2, 400)
    profile = radius * np.stack([np.cos(turn).clip(1e-12), np.sin(turn)], axis=1)
    ball = Solid(Frusta.from_profile(profile, 0, 1), (Opaque(0 * WHITE),), pose_at(0, 0, depth))
    sensor = plain_sensor(size=120, views=1, fx=700.0, blur=blur, focus=depth)
    sheet = Sheet(pose_at(0, 0, 1.0), (2.0, 2.0), WHITE, 1.0)
    view = render(plain_scene([ball], [sheet], sensor=sensor), rng, 8).light_field.centre_view
    area = (1 - view / view[0, 0]).sum() / 3
    expected = 700 * radius / np.sqrt(depth ** 2 - radius ** 2)
    assert np.sqrt(area / np.pi) == pytest.approx(expected, abs=0.02)
    rows, columns = np.indices(view.shape[:2])
    dark = 1 - view[..., 0] / view[0, 0, 0]
    middle = sensor.grid.pinhole.cx
    assert (dark * columns).sum() / dark.sum() == pytest.approx(middle, abs=0.03)
    assert (dark * rows).sum() / dark.sum() == pytest.approx(middle, abs=0.03)
