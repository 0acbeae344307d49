"""The renderer against rays cast by trimesh, and what must not show in a tile."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import bracket, random_poses
from scipy.ndimage import maximum_filter, minimum_filter

from pmcl_ros.errors import RenderError
from pmcl_ros.lightfield.geometry import Pinhole
from pmcl_ros.pmcl.zbuffers import Window, ZBuffers, sphere_bounds

CAMERA = Pinhole(71, 57, 110, 95, 33.2, 30.6)
WHOLE = Window(0, 0, (71, 57))
BOX = trimesh.creation.box((0.1, 0.06, 0.04))
SPHERE = trimesh.creation.icosphere(2, 0.05)
BOWL = trimesh.Trimesh(SPHERE.vertices, SPHERE.faces[SPHERE.triangles_center[:, 2] < 0.01])


def buffers(context, mesh, window=WHOLE, camera=CAMERA, near=0.1, far=1.0, **options):
    options = {'closed': bool(mesh.is_volume), 'capacity': 12} | options
    return ZBuffers(context, mesh.vertices, mesh.faces, camera, window, near, far, **options)


def drawn(context, mesh, poses, *args, **options):
    with buffers(context, mesh, *args, **options) as zbuffers:
        zbuffers.draw(poses)
        return zbuffers.read(len(poses))


def cast(mesh, pose, window):
    """(height, width) depth of the first surface on the ray of each pixel; 0: none."""
    width, height = window.size
    y, x = np.indices((height, width))
    at = [first + window.scale * cell + (window.scale - 1) / 2
          for first, cell in ((window.left, x), (window.top, y))]
    rays = np.stack([(at[0] - CAMERA.cx) / CAMERA.fx, (at[1] - CAMERA.cy) / CAMERA.fy,
                     np.ones_like(at[0])], axis=-1).reshape(-1, 3)
    moved = mesh.copy()
    moved.apply_transform(pose)
    places, ray, _ = moved.ray.intersects_location(np.zeros_like(rays), rays)
    depth = np.full(len(rays), np.inf)
    np.minimum.at(depth, ray, places[:, 2])
    return np.where(np.isfinite(depth), depth, 0).reshape(height, width)


def assert_same_view(seen, expected):
    """Equal everywhere, but for a pixel or two whose centre a border runs through."""
    assert (expected > 0).mean() > 0.03
    differing = np.abs(seen - expected) > 2e-5
    assert differing.sum() <= 2
    border = (maximum_filter(expected, 3) > 0) & (minimum_filter(expected, 3) == 0)
    assert not (differing & ~border).any()


@pytest.mark.parametrize('window', [WHOLE, Window(9, 4, (29, 25), 2), Window(3, 2, (16, 13), 4),
                                    Window(40, 11, (31, 37))])
@pytest.mark.parametrize('mesh', [BOX, SPHERE, BOWL], ids=['box', 'sphere', 'bowl'])
def test_depths_are_those_of_rays(context, mesh, window):
    poses = random_poses(4, seed=3, depth=(0.2, 0.3), aside=0.02)
    for seen, pose in zip(drawn(context, mesh, poses, window), poses, strict=True):
        assert_same_view(seen, cast(mesh, pose, window))


def test_an_open_mesh_is_seen_from_both_sides(context):
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, 2, 3] = 0.3
    poses[1, :3, :3] = np.diag([1, -1, -1])  # the opening towards the camera
    assert not BOWL.is_volume
    outside, inside = drawn(context, BOWL, poses)[:, 30, 33]
    assert outside == pytest.approx(0.25, abs=1e-3)
    assert inside == pytest.approx(0.35, abs=1e-3)


def test_back_faces_of_a_closed_mesh_change_nothing(context):
    poses = random_poses(10, seed=1, depth=(0.2, 0.3))
    mesh = bracket()
    culled, whole = (drawn(context, mesh, poses, closed=closed) for closed in (True, False))
    # A pixel at a silhouette's very edge may be covered by a back face alone.
    differing = culled != whole
    assert differing.mean() < 1e-3
    np.testing.assert_array_equal(culled[differing], 0)


def test_a_batch_is_its_poses_one_by_one(context):
    poses = random_poses(11, seed=2, depth=(0.2, 0.4))
    with buffers(context, BOX, capacity=1) as single:
        assert single.capacity == 1
        alone = []
        for pose in poses:
            single.draw(pose[None])
            alone.append(single.read(1)[0])
    together = drawn(context, BOX, poses, capacity=11)
    assert ((together > 0) != (np.array(alone) > 0)).mean() < 1e-3
    both = (together > 0) & (np.array(alone) > 0)
    np.testing.assert_allclose(together[both], np.array(alone)[both], atol=1e-5)


def test_what_is_larger_than_a_tile_stays_in_it(context):
    poses = np.tile(np.eye(4), (9, 1, 1))
    poses[:, 2, 3] = 0.3
    poses[1::2, 0, 3] = 3  # beside the image
    window = Window(20, 18, (21, 15))
    seen = drawn(context, trimesh.creation.box((2, 2, 0.1)), poses, window)
    np.testing.assert_allclose(seen[::2], 0.25, atol=1e-5)
    assert (seen[1::2] == 0).all()


def test_nothing_is_seen_of_what_is_behind_or_unknown(context):
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 2, 3] = 0.3
    poses[1, 2, 3] = -0.3
    poses[2, 0, 3] = np.nan
    poses[3, :3, :3] = np.nan
    poses[4, 1, 3] = np.inf
    seen = drawn(context, SPHERE, poses)
    assert (seen[1:5] == 0).all()
    np.testing.assert_allclose(seen[0], seen[5], atol=1e-6)
    assert (seen[0] > 0).any()


def test_what_is_nearer_than_near_or_farther_than_far_is_cut_off(context):
    pose = np.eye(4)
    pose[2, 3] = 0.3
    floor = trimesh.creation.box((0.4, 0.02, 2))
    floor.apply_translation((0, 0.06, 0))
    seen = drawn(context, floor, pose[None], near=0.2, far=0.4)[0]
    rows = np.arange(WHOLE.size[1])
    # The top at y = 0.05 m is seen in the rows whose rays meet it between the two.
    depth = CAMERA.fy * 0.05 / np.maximum(rows - CAMERA.cy, 1e-9)
    column = seen[:, 33]
    within = (depth > 0.2) & (depth < 0.4)
    assert 5 < within.sum() < 20
    np.testing.assert_array_equal(column > 0, within)
    np.testing.assert_allclose(column[within], depth[within], atol=2e-5)


def test_a_coarser_window_sees_the_same_rays():
    window = Window(8, 6, (40, 33))
    for scale in (2, 3, 4):
        coarse = window.coarser(scale)
        assert coarse.size[0] * scale >= 40 > (coarse.size[0] - 1) * scale
        cell = np.array([5, 7])
        pixel = np.array([8, 6]) + scale * cell + (scale - 1) / 2
        tile, image = coarse.pinhole(CAMERA), CAMERA
        np.testing.assert_allclose((cell - [tile.cx, tile.cy]) / [tile.fx, tile.fy],
                                   (pixel - [image.cx, image.cy]) / [image.fx, image.fy])


@settings(max_examples=100, deadline=None)
@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.11, 3), st.floats(0.001, 0.1))
def test_sphere_bounds_touch_the_sphere(x, y, z, radius):
    bounds = sphere_bounds(CAMERA, np.array([[x, y, z]]), radius)[0]
    rng = np.random.default_rng(0)
    around = rng.normal(size=(20_000, 3))
    around *= radius / np.linalg.norm(around, axis=1, keepdims=True)
    seen = CAMERA.project(np.array([x, y, z]) + around)
    low, high = seen.min(axis=0), seen.max(axis=0)
    slack = 0.02 * (high - low)
    assert (bounds[:2] <= low + 1e-6).all()
    assert (bounds[2:] >= high - 1e-6).all()
    assert (bounds[:2] >= low - slack).all()
    assert (bounds[2:] <= high + slack).all()


@pytest.mark.parametrize('z', [0.05, 0.0, -1.0, np.nan])
def test_bounds_of_a_sphere_at_the_camera_are_infinite(z):
    bounds = sphere_bounds(CAMERA, np.array([[0.0, 0.0, z]]), 0.05)
    np.testing.assert_array_equal(bounds, [[-np.inf, -np.inf, np.inf, np.inf]])


def test_impossible_work_is_refused(context):
    with buffers(context, BOX, capacity=4) as zbuffers, \
            pytest.raises(RenderError, match='5 poses in one batch, this atlas holds 4'):
        zbuffers.draw(np.tile(np.eye(4), (5, 1, 1)))
    for near, far in ((0, 1), (0.5, 0.4), (-1, 1)):
        with pytest.raises(RenderError, match='the object would be at the camera'):
            buffers(context, BOX, near=near, far=far)
    with pytest.raises(RenderError, match='100000x3 pixels is beyond this GL'):
        buffers(context, BOX, Window(0, 0, (100_000, 3)))


def test_an_atlas_has_room_for_what_it_can_hold(context):
    with buffers(context, BOX, Window(0, 0, (9000, 20)), capacity=6) as zbuffers:
        assert zbuffers.capacity == zbuffers.tiles[0] * zbuffers.tiles[1]
        assert zbuffers.capacity >= min(6, context.limit('GL_MAX_TEXTURE_SIZE') // 9000)
    with buffers(context, BOX, Window(0, 0, (6000, 6000)), capacity=50) as zbuffers:
        assert zbuffers.capacity == 1  # 137 MiB are enough
