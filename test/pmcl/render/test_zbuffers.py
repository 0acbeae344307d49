"""Both renderers against rays cast by trimesh and each other, and what must not show."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pmcl_scenes import bracket, cup, model_of, random_poses
from scipy.ndimage import maximum_filter, minimum_filter

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.render.gl_renderer import GlRenderer
from pmcl_ros.pmcl.render.gl_zbuffers import ZBuffers
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window, sphere_bounds
from pmcl_ros.runtime.errors import RenderError

CAMERA = Pinhole(71, 57, 110, 95, 33.2, 30.6)
WHOLE = Window(0, 0, (71, 57))
BOX = trimesh.creation.box((0.1, 0.06, 0.04))
SPHERE = trimesh.creation.icosphere(2, 0.05)
BOWL = trimesh.Trimesh(SPHERE.vertices, SPHERE.faces[SPHERE.triangles_center[:, 2] < 0.01])


@pytest.fixture(params=['gl', 'numba'])
def renderer(request):
    if request.param == 'numba':
        return NumbaRenderer()
    return GlRenderer(request.getfixturevalue('context'))


def scene(mesh, window=WHOLE, camera=CAMERA, near=0.1, far=1.0, closed=None):
    model = model_of(mesh)
    if closed is not None:
        model = replace(model, closed=closed)
    return Scene(model, camera, window, near, far)


def drawn(renderer, mesh, poses, *args, **options):
    return renderer.depths(scene(mesh, *args, **options), poses)


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
def test_depths_are_those_of_rays(renderer, mesh, window):
    poses = random_poses(4, seed=3, depth=(0.2, 0.3), aside=0.02)
    for seen, pose in zip(drawn(renderer, mesh, poses, window), poses, strict=True):
        assert_same_view(seen, cast(mesh, pose, window))


def test_an_open_mesh_is_seen_from_both_sides(renderer):
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, 2, 3] = 0.3
    poses[1, :3, :3] = np.diag([1, -1, -1])  # the opening towards the camera
    assert not BOWL.is_volume
    outside, inside = drawn(renderer, BOWL, poses)[:, 30, 33]
    assert outside == pytest.approx(0.25, abs=1e-3)
    assert inside == pytest.approx(0.35, abs=1e-3)


def test_back_faces_of_a_closed_mesh_change_nothing(renderer):
    poses = random_poses(10, seed=1, depth=(0.2, 0.3))
    mesh = bracket()
    culled, whole = (drawn(renderer, mesh, poses, closed=closed) for closed in (True, False))
    # A pixel at a silhouette's very edge may be covered by a back face alone.
    differing = culled != whole
    assert differing.mean() < 1e-3
    np.testing.assert_array_equal(culled[differing], 0)


def test_a_batch_is_its_poses_one_by_one(renderer):
    poses = random_poses(11, seed=2, depth=(0.2, 0.4))
    alone = np.array([drawn(renderer, BOX, pose[None])[0] for pose in poses])
    together = drawn(renderer, BOX, poses)
    assert ((together > 0) != (alone > 0)).mean() < 1e-3
    both = (together > 0) & (alone > 0)
    np.testing.assert_allclose(together[both], alone[both], atol=1e-5)


def test_what_is_larger_than_a_tile_stays_in_it(renderer):
    poses = np.tile(np.eye(4), (9, 1, 1))
    poses[:, 2, 3] = 0.3
    poses[1::2, 0, 3] = 3  # beside the image
    window = Window(20, 18, (21, 15))
    seen = drawn(renderer, trimesh.creation.box((2, 2, 0.1)), poses, window)
    np.testing.assert_allclose(seen[::2], 0.25, atol=1e-5)
    assert (seen[1::2] == 0).all()


def test_nothing_is_seen_of_what_is_behind_or_unknown(renderer):
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 2, 3] = 0.3
    poses[1, 2, 3] = -0.3
    poses[2, 0, 3] = np.nan
    poses[3, :3, :3] = np.nan
    poses[4, 1, 3] = np.inf
    seen = drawn(renderer, SPHERE, poses)
    assert (seen[1:5] == 0).all()
    np.testing.assert_allclose(seen[0], seen[5], atol=1e-6)
    assert (seen[0] > 0).any()


def test_what_is_nearer_than_near_or_farther_than_far_is_cut_off(renderer):
    pose = np.eye(4)
    pose[2, 3] = 0.3
    floor = trimesh.creation.box((0.4, 0.02, 2))
    floor.apply_translation((0, 0.06, 0))
    seen = drawn(renderer, floor, pose[None], near=0.2, far=0.4)[0]
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
    with ZBuffers(context, scene(BOX), capacity=4) as zbuffers, \
            pytest.raises(RenderError, match='5 poses in one batch, this atlas holds 4'):
        zbuffers.draw(np.tile(np.eye(4), (5, 1, 1)))
    for near, far in ((0, 1), (0.5, 0.4), (-1, 1)):
        with pytest.raises(RenderError, match='the object would be at the camera'):
            scene(BOX, near=near, far=far)
    wide = scene(BOX, Window(0, 0, (100_000, 3)))
    with pytest.raises(RenderError, match='100000x3 pixels is beyond this GL'):
        ZBuffers(context, wide)
    with pytest.raises(RenderError, match='100000x3 pixels is drawn on the processor up to'):
        NumbaRenderer().depths(wide, np.eye(4)[None])


def test_an_atlas_has_room_for_what_it_can_hold(context):
    with ZBuffers(context, scene(BOX, Window(0, 0, (9000, 20))), capacity=6) as zbuffers:
        assert zbuffers.capacity == zbuffers.tiles[0] * zbuffers.tiles[1]
        assert zbuffers.capacity >= min(6, context.limit('GL_MAX_TEXTURE_SIZE') // 9000)
    with ZBuffers(context, scene(BOX, Window(0, 0, (6000, 6000))), capacity=50) as zbuffers:
        assert zbuffers.capacity == 1  # 137 MiB are enough


@pytest.mark.parametrize('window', [Window(0, 0, (237, 213)), Window(31, 20, (80, 71), 2)])
@pytest.mark.parametrize('mesh', [cup(), bracket(), SPHERE, BOWL],
                         ids=['cup', 'bracket', 'sphere', 'bowl'])
def test_both_draw_the_same_pixels(context, mesh, window):
    camera = Pinhole(237, 213, 720, 690, 120.5, 103.0)
    poses = random_poses(40, seed=7, depth=(0.25, 0.5), aside=0.06)
    gl, cpu = (drawn(each, mesh, poses, window, camera)
               for each in (GlRenderer(context), NumbaRenderer()))
    assert (gl > 0).mean() > 0.05
    # The corners are rounded to 1/256 px, from floats that differ in their last bits.
    differing = (gl > 0) != (cpu > 0)
    assert differing.sum() <= 0.25 * len(poses)
    both = (gl > 0) & (cpu > 0)
    np.testing.assert_allclose(np.median(np.abs(gl - cpu)[both]), 0, atol=1e-7)
    # Where a surface is seen edge-on a hair's breadth is a long way.
    assert (np.abs(gl - cpu)[both] > 1e-4).mean() < 1e-3


@pytest.mark.parametrize('shift', [(0, 0), (300, -60), (-900, 400)])
def test_what_is_cut_by_the_camera_plane_is_drawn_as_far_as_it_is_seen(context, shift):
    # A floor from behind the camera to far away: every corner needs clipping.
    floor = trimesh.Trimesh([[-50, 0.1, -5], [50, 0.1, -5], [50, 0.1, 40], [-50, 0.1, 40]],
                            [[0, 1, 2], [0, 2, 3]])
    camera = Pinhole(71, 57, 110, 95, 33.2 + shift[0], 30.6 + shift[1])
    gl, cpu = (drawn(each, floor, np.eye(4)[None], WHOLE, camera, 0.05, 30.0)
               for each in (GlRenderer(context), NumbaRenderer()))
    np.testing.assert_allclose(cpu, gl, rtol=1e-4)
    assert (cpu > 0).any() == (shift[1] < 300)


def test_neighbouring_triangles_leave_no_gap_and_do_not_overlap():
    # Corners on pixel centres, edges through others: each pixel is one triangle's.
    renderer = NumbaRenderer()
    camera = Pinhole(40, 40, 40, 40, 0, 0)
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(5, 36, 6), np.arange(5, 36, 6)), axis=-1).reshape(-1, 2)
    grid = grid + rng.integers(-2, 3, grid.shape)
    points = np.concatenate([grid / 40, np.ones((len(grid), 1))], axis=1)
    faces = [[r * 6 + c + k for k in corners] for r in range(5) for c in range(5)
             for corners in ((0, 1, 6), (1, 7, 6))]
    covered = np.zeros((40, 40), int)
    for face in faces:
        one = trimesh.Trimesh(points, [face], process=False)
        covered += drawn(renderer, one, np.eye(4)[None], Window(0, 0, (40, 40)), camera,
                         closed=False)[0] > 0
    whole = drawn(renderer, trimesh.Trimesh(points, faces, process=False), np.eye(4)[None],
                  Window(0, 0, (40, 40)), camera, closed=False)[0]
    assert covered.max() == 1
    np.testing.assert_array_equal(whole > 0, covered > 0)
    assert (covered > 0).sum() > 500
