"""Pictures by path tracing: against the package's own renderer, and against physics."""

import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.light_field import ViewGrid, nominal_positions
from pmcl_ros.simulation.path_tracing.render import physical
from pmcl_ros.simulation.path_tracing.variant import is_compiled
from pmcl_ros.simulation.scenes.environment import (
    Environment,
    look_up,
    random_environment,
    random_lit_environment,
)
from pmcl_ros.simulation.scenes.materials import Clear, Opaque, fresnel
from pmcl_ros.simulation.scenes.render import fast
from pmcl_ros.simulation.scenes.scene import Decal, Scene, Sheet, Solid
from pmcl_ros.simulation.scenes.sensor import Sensor
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.shapes.vessels import random_vessel
from pmcl_ros.simulation.scenes.textures import SIZE, random_texture

WHITE = Environment(np.ones((64, 128, 3), np.float32))
BLACK = np.zeros((SIZE, SIZE, 3), np.float32)
LEVEL = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # the camera looks along the world's y


def sensor(width: int = 96, height: int = 72, focal: float = 120.0, square: bool = False
           ) -> Sensor:
    ratio = 1.0 if square else 1.1
    pinhole = Pinhole(width, height, focal, focal * ratio, width / 2 + 3, height / 2 - 5)
    grid = ViewGrid(pinhole, 1e-5, nominal_positions(1, 1), np.ones((1, 1), np.float32))
    return Sensor(grid, 0.5, 4.0, 0.5, 0.3, 0.0, 0.0, (1.0, 1.0, 1.0))


def scene(solids: tuple[Solid, ...] = (), sheets: tuple[Sheet, ...] = (),
          room: Environment = WHITE, turn: NDArray[np.float64] = LEVEL) -> Scene:
    return Scene('test', solids, sheets, room, turn, sensor(), (), (0,) * len(solids))


def both(of: Scene, samples: int = 64, its: Sensor | None = None
         ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """By the package's renderer and by path tracing."""
    its = its or of.sensor
    return fast(of)(its, 0, 0, 0, samples, 1), physical(of)(its, 0, 0, 0, samples, 1)


def standing(rng: np.random.Generator, depth: float = 0.4) -> NDArray[np.float64]:
    """The pose of an object before the camera, tilted."""
    return pose_of(Rotation.from_euler('x', 100, degrees=True)
                   * Rotation.from_rotvec(rng.normal(0, 0.3, 3)), np.array([0, 0, depth]))


def box(depth: float, thick: float, medium: Clear) -> Solid:
    """A wide slab across the optical axis."""
    mesh = trimesh.creation.box((1.0, 1.0, thick))
    return Solid(Triangles(np.asarray(mesh.triangles, float), 0, 1), (medium,),
                 pose_of(Rotation.identity(), np.array([0, 0, depth])))


def test_every_direction_of_the_room_is_where_it_belongs() -> None:
    rng = np.random.default_rng(0)
    panorama = cv2.GaussianBlur(random_environment(rng).panorama, (0, 0), 6)
    turn = Rotation.random(None, rng).as_matrix()
    of = scene(room=Environment(panorama), turn=turn)
    pinhole = of.sensor.grid.pinhole
    seen = physical(of)(of.sensor, 0, 0, 0, 32, 0)
    for i, j in ((5, 7), (40, 60), (70, 90), (20, 80)):
        way = turn @ np.array([(j - pinhole.cx) / pinhole.fx, (i - pinhole.cy) / pinhole.fy, 1])
        np.testing.assert_allclose(seen[i, j], look_up(panorama, *way / np.linalg.norm(way)),
                                   rtol=0.02)


def test_textures_lie_where_the_own_renderer_lays_them() -> None:
    rng = np.random.default_rng(1)
    printed = Opaque(random_texture(rng, ('checks',)), 0.1)
    body = Solid(Frusta.from_profile(random_vessel(rng, ('bottle',)).closed, 0, 1), (printed,),
                 standing(rng))
    wall = Sheet(pose_of(Rotation.from_rotvec([0.2, 0.4, 0.3]), np.array([0, 0, 0.7])),
                 (0.3, 0.4), random_texture(rng, ('checks',)), 0.13)
    own, traced = both(scene((body,), (wall,)), 128)
    # Interreflections and occlusion make the mean differ by some per cent, nothing moves.
    assert np.corrcoef(own.ravel(), traced.ravel())[0, 1] > 0.985
    smooth = [cv2.cvtColor(each, cv2.COLOR_RGB2GRAY) for each in (own, traced)]
    shift, response = cv2.phaseCorrelate(*smooth)
    assert np.hypot(*shift) < 0.1
    assert response > 0.8


def test_texels_lie_where_they_belong() -> None:
    """Some ten pixels each, on a wall across the optical axis."""
    texel, depth = 0.06, 0.7
    numbers = np.arange(SIZE, dtype=np.float32) / SIZE
    texture = np.stack([np.broadcast_to(numbers, (SIZE, SIZE)),
                        np.broadcast_to(numbers[:, None], (SIZE, SIZE)),
                        np.full((SIZE, SIZE), 0.5, np.float32)], axis=-1)
    wall = Sheet(pose_of(Rotation.identity(), np.array([-20 * texel, -30 * texel, depth])),
                 (SIZE * texel, SIZE * texel), texture, SIZE * texel)
    own, traced = both(scene(sheets=(wall,)), 64)
    pinhole = sensor().grid.pinhole
    v, u = np.mgrid[:pinhole.height, :pinhole.width]
    column = 20 + depth * (u - pinhole.cx) / pinhole.fx / texel
    row = 30 + depth * (v - pinhole.cy) / pinhole.fy / texel
    for seen in (own, traced):
        number = SIZE * 0.5 * seen[..., :2] / seen[..., 2:]  # in any light
        np.testing.assert_allclose(number[..., 0], column, atol=0.03)
        np.testing.assert_allclose(number[..., 1], row, atol=0.03)


@pytest.mark.parametrize('seed', [0, 2])
def test_outlines_agree_to_a_tenth_of_a_pixel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body = Solid(Frusta.from_profile(random_vessel(rng).closed, 0, 1),
                 (Opaque(BLACK),), standing(rng))
    own, traced = (1 - each[..., 0] for each in both(scene((body,)), 256))
    columns = np.arange(own.shape[1])
    for across in (own, traced):
        assert across.max() == pytest.approx(1, abs=1e-3)
    rows = own.sum(axis=1) > 5
    width = [each.sum(axis=1)[rows] for each in (own, traced)]
    middle = [(each * columns).sum(axis=1)[rows] / across
              for each, across in zip((own, traced), width, strict=True)]
    assert np.abs(middle[0] - middle[1]).max() < 0.1
    assert np.abs(width[0] - width[1]).max() < 0.2  # two outlines, a tenth of a pixel each


def test_a_vessel_bends_light_as_in_the_own_renderer() -> None:
    rng = np.random.default_rng(4)
    vessel = random_vessel(rng, ('tumbler',), walls=(0.004, 0.005))
    profile = np.concatenate([vessel.outer, vessel.inner[1:]])
    glass = Solid(Frusta.from_profile(profile, 0, 1), (Clear(1.5, (3.0, 8.0, 20.0)),),
                  standing(rng, 0.3))
    wall = Sheet(pose_of(Rotation.identity(), np.array([0, 0, 0.5])), (1.0, 1.0),
                 random_texture(rng, ('clouds',)), 0.2)
    its = sensor(64, 48, 80.0)
    own, traced = both(scene((glass,), (wall,)), 256, its)
    plain = fast(scene((), (wall,)))(its, 0, 0, 0, 64, 1)
    bent = np.abs(own - plain).mean(axis=2) > 0.02
    assert bent.sum() > 300
    # Glass throws a faint shadow, which the own renderer casts in rooms with lamps only.
    assert np.corrcoef(own[bent].ravel(), traced[bent].ravel())[0, 1] > 0.98
    shift, response = cv2.phaseCorrelate(*(cv2.cvtColor(each * bent[..., None], cv2.COLOR_RGB2GRAY)
                                           for each in (own, traced)))
    assert np.hypot(*shift) < 0.1
    assert response > 0.8


def test_clear_things_in_a_white_room_are_white() -> None:
    rng = np.random.default_rng(5)
    vessel = random_vessel(rng, ('stemmed',))
    glass = Solid(Frusta.from_profile(vessel.closed, 0, 1), (Clear(1.52),), standing(rng))
    seen = physical(scene((glass,)))(sensor(), 0, 0, 0, 64, 1)
    assert np.abs(np.median(seen) - 1) < 1e-4
    assert (seen > 0.98).mean() > 0.98  # but what is trapped for more bounces than are followed


def test_ground_glass_in_a_white_room_is_darker_by_path_tracing() -> None:
    room = np.ones((256, 512, 3), np.float32)
    lamp = np.array([[0.2, 0.3, 0.0, 0.2, 1, 1, 1]])  # as bright as the room
    rng = np.random.default_rng(5)
    vessel = random_vessel(rng, ('stemmed',))
    glass = Solid(Frusta.from_profile(vessel.closed, 0, 1), (Clear(1.52, roughness=0.24),),
                  standing(rng))
    own, traced = both(scene((glass,), room=Environment(room, lamp, room)))
    shown = (np.abs(traced - 1) > 1e-3).any(axis=2)
    assert 0.1 < shown.mean() < 0.3
    assert 0.97 < own[shown].mean() <= 1
    assert 0.85 < traced[shown].mean() < 0.95


def test_a_slab_absorbs_and_reflects_as_fresnel_and_beer_say() -> None:
    absorption = (5.0, 20.0, 60.0)
    its = sensor(24, 24)
    seen = physical(scene((box(0.4, 0.02, Clear(1.5, absorption)),)))(its, 0, 0, 0, 256, 1)
    pinhole = its.grid.pinhole
    across, down = round(pinhole.cx), round(pinhole.cy)
    middle = seen[down - 4:down + 5, across - 4:across + 5].mean(axis=(0, 1))
    share = fresnel(1.0, 1.0, 1.5)[0]
    through = np.exp(-np.array(absorption) * 0.02)
    passed = (1 - share) ** 2 * through / (1 - (share * through) ** 2)
    bounced = share + share * (1 - share) ** 2 * through ** 2 / (1 - (share * through) ** 2)
    np.testing.assert_allclose(middle, passed + bounced, rtol=0.01)


def test_a_label_hides_a_glass_on_its_side_only() -> None:
    profile = np.array([[0, -0.04], [0.03, -0.04], [0.03, 0.04], [0, 0.04]])
    label = Decal((-0.02, 0.02), (-np.pi / 4, np.pi / 4), BLACK, 0.1)
    glass = Solid(Frusta.from_profile(profile, 0, 1), (Clear(1.0001),),
                  pose_of(Rotation.from_euler('xz', [90, 90], degrees=True).inv(),
                          np.array([0, 0, 0.4])), label)
    room = random_lit_environment(np.random.default_rng(6))
    own, traced = (each.mean(axis=2) < 0.01 * room.panorama.mean()
                   for each in both(scene((glass,), room=room), 64))
    assert own.sum() > 50
    assert np.mean(own != traced) < 0.005


def test_a_scene_looks_the_same_whatever_was_drawn_before() -> None:
    body = Solid(Frusta.from_profile(np.array([[0, -0.03], [0.03, -0.03], [0.03, 0.03],
                                               [0, 0.03]]), 0, 1), (Opaque(BLACK, 0.1, 1.5),),
                 standing(np.random.default_rng(7)))
    first = physical(scene((body,)))(sensor(), 0, 0, 0, 8, 1)
    for _ in range(3):
        physical(scene((box(0.4, 0.02, Clear(1.5)),)))(sensor(), 0, 0, 0, 8, 1)
        again = physical(scene((body,)))(sensor(), 0, 0, 0, 8, 1)
        np.testing.assert_allclose(again, first, atol=1e-5)  # sums are rounded in any order


def test_without_llvm_it_runs_ray_by_ray() -> None:
    made = subprocess.run(
        [sys.executable, '-c', 'from test_path_tracing import *; from pmcl_ros.simulation.'
         'path_tracing.variant import is_compiled; assert not is_compiled(); '
         'aside = Sheet(pose_of(Rotation.identity(), np.array([0.05, -0.03, 0.5])), (0.1, 0.1), '
         'BLACK, 1.0); its = sensor(48, 36, 60, True); '
         'own, traced = both(scene((box(0.7, 0.01, Clear(1.5)),), (aside,)), 16, its); '
         'assert own.min() < 0.01; assert (abs(own - traced) > 0.2).mean() < 0.01; '
         'print("same")'],
        env=os.environ | {'DRJIT_LIBLLVM_PATH': os.devnull, 'PYTHONPATH': os.pathsep.join(
            [os.path.dirname(__file__), *sys.path])}, capture_output=True, text=True)
    assert made.stdout == 'same\n', made.stderr[-2000:]


def test_all_passes_of_a_scene_are_compiled_once() -> None:
    """Compiling takes seconds, much longer than most passes."""
    dr = pytest.importorskip('drjit')
    if not is_compiled():
        pytest.skip('Mitsuba is not compiled: no LLVM library')
    of = physical(scene((box(0.4, 0.01, Clear(1.5)),)))
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        for width, height, focal, seed in ((24, 24, 40.0, 1), (32, 20, 50.0, 2)):
            of(sensor(width, height, focal), 0, 0, 0, 32, seed)
        passes = [each['hash'] for each in dr.kernel_history()
                  if each['type'] == dr.KernelType.JIT and each['operation_count'] > 1000]
    assert len(passes) == 2 * 8
    assert len(set(passes)) <= 2
