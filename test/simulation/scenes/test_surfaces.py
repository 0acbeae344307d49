"""Where rays meet surfaces of revolution and meshes."""

import numpy as np
import pytest
import trimesh
from plain_scenes import light_along, plain_scene, pose_at, rays_through

from pmcl_ros.simulation.scenes.materials import Clear
from pmcl_ros.simulation.scenes.objects import random_transparent
from pmcl_ros.simulation.scenes.scene import Solid
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta, frustum_normal, meet_frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles, meet_triangles
from pmcl_ros.simulation.scenes.shapes.vessels import random_vessel
from pmcl_ros.simulation.scenes.trace import nearest
from pmcl_ros.simulation.scenes.world import World


def _by_hand(triangles, origins, directions):
    """(rays,) first t of each ray, by testing all triangles; inf where there is none."""
    first = np.full(len(origins), np.inf)
    a, e, f = triangles[:, 0], *np.moveaxis(np.diff(triangles, axis=1), 1, 0)
    f = e + f
    for k, (o, d) in enumerate(zip(origins, directions, strict=True)):
        p = np.cross(d, f)
        with np.errstate(divide='ignore', invalid='ignore'):
            scale = 1 / (e * p).sum(axis=1)
            u = scale * ((o - a) * p).sum(axis=1)
            q = np.cross(o - a, e)
            v, t = scale * (q @ d), scale * (f * q).sum(axis=1)
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)
        first[k] = t[hit].min(initial=np.inf)
    return first


def _meshes(rng, count):
    for _ in range(count):
        vessel = random_vessel(rng)
        yield vessel, trimesh.creation.revolve(vessel.closed, sections=360)


def test_frusta_are_a_fine_mesh():
    rng = np.random.default_rng(3)
    for vessel, mesh in _meshes(rng, 2):
        first, lists, bounds = Frusta.from_profile(vessel.closed, 0, 1).binned()
        rings = Frusta.from_profile(vessel.closed, 0, 1).rings
        origins, ways = rays_through(rng, 50, np.zeros(3), 0.05)
        expected = _by_hand(np.asarray(mesh.triangles), origins, ways)
        at = np.array([0, len(first) - 1])
        found = np.array([meet_frusta(rings, first, lists, at, bounds, *o, *d, 1e-6, 1e3)[0]
                          for o, d in zip(origins, ways, strict=True)])
        found[found == 1e3] = np.inf
        both = np.isfinite(found) & np.isfinite(expected)
        # Rays that graze one of the two may miss the other, or meet it far behind.
        assert (np.isfinite(found) != np.isfinite(expected)).sum() <= 2
        assert np.median(np.abs(found[both] - expected[both])) < 4e-6
        assert (np.abs(found[both] - expected[both]) > 2e-4).sum() <= 2
        assert both.sum() > 15


def test_a_tree_of_boxes_leaves_no_triangle_out():
    rng = np.random.default_rng(5)
    mesh = trimesh.creation.icosphere(2, 0.05)
    mesh.vertices *= 1 + 0.3 * rng.standard_normal((len(mesh.vertices), 1))
    boxes, nodes, corners = Triangles(np.asarray(mesh.triangles), 0, 1).tree()
    origins, ways = rays_through(rng, 300, np.zeros(3), 0.06)
    stack = np.zeros(64, np.int64)
    found = np.array([meet_triangles(boxes, nodes, corners, 0, 0, stack, *o, *d, 1e-6, 1e3)[0]
                      for o, d in zip(origins, ways, strict=True)])
    expected = np.minimum(_by_hand(np.asarray(mesh.triangles), origins, ways), 1e3)
    assert found == pytest.approx(expected, abs=1e-9)
    assert (expected < 1e3).sum() > 100


@pytest.mark.parametrize('seed', range(6))
def test_media_follow_each_other_along_every_ray(seed):
    """What lies behind one interface lies before the next: glass, liquid, air, content."""
    rng = np.random.default_rng(seed)
    thing = random_transparent(rng)
    world = World.from_scene(plain_scene(thing.placed(pose_at(0, 0, 0))))
    hit, stack = np.zeros(9), np.zeros(64, np.int64)
    origins, ways = rays_through(rng, 150, np.zeros(3), 0.07)
    breaks, crossings = 0, 0
    for o, d in zip(origins, ways, strict=True):
        medium = 0
        for _ in range(40):
            kind, t, _, outside, inside = nearest(world, hit, stack, *o, *d)
            if kind != 1 or world.materials[medium, 0] == 0:
                break
            o = o + t * d
            leaves = hit[3:6] @ d > 0
            breaks += medium != (inside if leaves else outside)
            crossings += 1
            medium = outside if leaves else inside
        else:
            pytest.fail('a ray that never leaves')
        if world.materials[medium, 0] == 1:
            assert medium == 0
    assert crossings > 150
    assert breaks == 0


def test_normals_stand_on_the_surface():
    vessel = random_vessel(np.random.default_rng(1), ('stemmed',))
    rings = Frusta.from_profile(np.concatenate([vessel.outer, vessel.inner[1:]]), 0, 1).rings
    for ring in rings:
        normal = np.array(frustum_normal(ring, 0.4, 0.6, 0.8))
        along = np.array([0.6 * (ring[2] - ring[0]), 0.8 * (ring[2] - ring[0]), ring[3] - ring[1]])
        assert np.linalg.norm(normal[:3]) == pytest.approx(1)
        assert normal[3:] @ along == pytest.approx(0, abs=1e-12)
        assert normal[:3] @ normal[3:] > 0.8


def test_glass_is_invisible_where_all_is_equally_bright():
    """Light is neither made nor lost at interfaces, however it is split."""
    rng = np.random.default_rng(8)
    for _ in range(4):
        vessel = random_vessel(rng)
        profile = np.concatenate([vessel.outer, vessel.inner[1:]])
        solid = Solid(Frusta.from_profile(profile, 0, 1), (Clear(1.5),), pose_at(0, 0, 0))
        world = World.from_scene(plain_scene([solid], light=0.7))
        light = light_along(world, *rays_through(rng, 4000, np.zeros(3), 0.04))
        assert light.mean() == pytest.approx(0.7, rel=0.01)


def test_absorption_is_that_of_the_way_through():
    solid = Solid(Triangles(np.asarray(trimesh.creation.box((1, 1, 0.02)).triangles), 0, 1),
                  (Clear(1.0, (10.0, 30.0, 0.0)),), pose_at(0, 0, 0.3))
    world = World.from_scene(plain_scene([solid]))
    light = light_along(world, np.array([[0.01, 0.013, 0]]), np.array([[0.6, 0, 0.8]]))
    assert light[0] == pytest.approx(np.exp(-np.array([10, 30, 0]) * 0.02 / 0.8))
