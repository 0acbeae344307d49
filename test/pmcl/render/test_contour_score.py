"""The contour score of both renderers against the same in numpy, from their own z-buffers."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pmcl_scenes import bracket, cup, model_of, random_poses
from scipy.ndimage import gaussian_filter, map_coordinates

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.render.gl_contour import GlContourScore
from pmcl_ros.pmcl.render.gl_renderer import GlRenderer
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.kernel_threads import set_threads

NARROW = Pinhole(71, 57, 110, 95, 33.2, 30.6)
WIDE = Pinhole(97, 61, 40, 44, 50, 28)
WHOLE = Window(0, 0, (71, 57))
CONTRAST = ContourProfile.contrast()
# As much as a profile may hold, of values that nothing else explains.
LARGEST = ContourProfile(
    np.array([-5, -3, -1.5, 0, 1.5, 3, 5, 8], np.float32),
    np.array([0, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.5, 3], np.float32),
    np.random.default_rng(0).normal(size=(8, 9)).astype(np.float32), -0.3)


@pytest.fixture(params=['gl', 'numba'])
def renderer(request):
    if request.param == 'numba':
        return NumbaRenderer()
    return GlRenderer(request.getfixturevalue('context'))


def scene(mesh, window=WHOLE, camera=NARROW, near=0.1, far=0.5):
    return Scene(model_of(mesh), camera, window, near, far)


def random_edges(pinhole, labels=7, near=0.15, far=0.5, seed=0):
    """Positive semi-definite tensors that vary over a few pixels and labels."""
    rng = np.random.default_rng(seed)
    gradients = gaussian_filter(rng.normal(size=(pinhole.height, pinhole.width, labels, 2, 3)),
                                (1.5, 1.5, 0.7, 0, 0)) * 9
    gx, gy = gradients[..., 0, :], gradients[..., 1, :]
    tensor = np.stack([(gx * gx).sum(-1), (gy * gy).sum(-1), (gx * gy).sum(-1)], axis=-1)
    return EdgeVolume(Header(), tensor.astype(np.float32), depth_labels(near, far, labels),
                      pinhole)


def drawn(renderer, score, seen, poses):
    """(n, height, width) the depths that a score has just seen: its own, to the pixel."""
    if isinstance(renderer, NumbaRenderer):
        return renderer.depths(seen, poses).astype(float)
    inverse = score.zbuffers.closeness(len(poses)).astype(float)
    return np.divide(1, inverse, out=np.zeros_like(inverse), where=inverse > 0)


def evidence(depth, window, edges, radius, profile=CONTRAST):
    """Sum and length of what docs/concepts/evidence.md says, in double precision."""
    close = np.divide(1, depth, out=np.zeros(depth.shape), where=depth > 0)
    jump = 0.2 * radius * (1 / edges.depths).mean()
    padded = np.pad(close, 3, constant_values=-1)  # outside the tile nothing is known
    pairs = []
    for dy, dx in ((0, 1), (1, 0)):
        here, there = close[:close.shape[0] - dy, :close.shape[1] - dx], close[dy:, dx:]
        y, x = np.nonzero(np.minimum(here, there) < np.maximum(here, there) * (1 - jump))
        first = here[y, x] > there[y, x]
        pairs.append(np.stack([np.where(first, y, y + dy), np.where(first, x, x + dx),
                               y + dy / 2, x + dx / 2], axis=-1))
    near_y, near_x, y, x = np.concatenate(pairs).T
    near_y, near_x = near_y.astype(int), near_x.astype(int)
    near = close[near_y, near_x]
    normal = np.zeros((len(near), 2))
    for dy, dx in np.ndindex(5, 5):
        other = padded[near_y + dy + 1, near_x + dx + 1]
        beyond = (other >= 0) & (other < near * (1 - jump))
        weight = np.exp(-0.35 * ((dy - 2) ** 2 + (dx - 2) ** 2)) * beyond
        normal += weight[:, None] * [dy - 2, dx - 2]
    length = np.linalg.norm(normal, axis=1)
    known = length ** 2 >= 1e-6
    ny, nx = (normal / np.maximum(length, 1e-9)[:, None]).T
    inverse = 1 / edges.depths
    label = (near - inverse[0]) / (inverse[1] - inverse[0])
    shift = (window.scale - 1) / 2
    image_y, image_x = (first + window.scale * cell + shift
                        for first, cell in ((window.top, y), (window.left, x)))
    tensor = edges.tensor.astype(float)

    def energy(distance):
        at = [image_y + distance * ny, image_x + distance * nx, label]
        xx, yy, xy = (map_coordinates(tensor[..., k], at, order=1, mode='nearest')
                      for k in range(3))
        return np.sqrt(np.maximum(xx * nx ** 2 + yy * ny ** 2 + 2 * xy * nx * ny, 0))

    energies = np.stack([energy(offset) for offset in profile.offsets], axis=-1)
    pixels = window.scale / np.maximum(np.abs(nx) + np.abs(ny), 1e-9) * known
    return pixels @ profile.evidence(energies), pixels.sum()


@pytest.mark.parametrize('profile', [CONTRAST, LARGEST])
@pytest.mark.parametrize(('camera', 'window'), [
    (NARROW, WHOLE), (NARROW, Window(13, 5, (40, 41))), (NARROW, Window(2, 1, (23, 18), 3)),
    (WIDE, Window(0, 0, (97, 61)))])
@pytest.mark.parametrize('mesh', [cup(), bracket()], ids=['cup', 'bracket'])
def test_evidence_is_the_definition(renderer, camera, window, mesh, profile):
    # Some nearer, some farther than the labels, some across the image's border.
    poses = random_poses(11, seed=4, depth=(0.14, 0.4), aside=0.2 if camera is WIDE else 0.06)
    seen = scene(mesh, window, camera, 0.05)
    edges = random_edges(camera)
    with renderer.contour_score(seen, edges, profile) as score:
        sums = score.evaluate(poses)
        np.testing.assert_array_equal(score(poses), sums[:, 0])
        depths = drawn(renderer, score, seen, poses)
    expected = np.array([evidence(depth, window, edges, seen.model.radius, profile)
                         for depth in depths])
    assert (expected[:, 1] > 15).sum() >= 8
    assert np.ptp(expected[:, 0]) > 10
    np.testing.assert_allclose(sums[:, 1], expected[:, 1], rtol=1e-3)
    # As evidence of either sign adds up, its error is measured against the length.
    assert (np.abs(sums[:, 0] - expected[:, 0]) <= 1e-3 * np.maximum(expected[:, 1], 1)).all()


def test_evidence_of_one_label_is_as_the_same_at_each(renderer):
    edges, seen = random_edges(NARROW), scene(bracket())
    one = replace(edges, tensor=edges.tensor[:, :, 3:4])
    each = replace(edges, tensor=np.repeat(one.tensor, 7, axis=2))
    sums = []
    for of in (one, each):
        with renderer.contour_score(seen, of, LARGEST) as score:
            sums.append(score.evaluate(random_poses(8, seed=4, depth=(0.14, 0.4))))
    assert np.ptp(sums[0][:, 0]) > 10
    np.testing.assert_allclose(sums[0], sums[1], rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize('scale', [1, 2])
@pytest.mark.parametrize('mesh', [cup(), bracket()], ids=['cup', 'bracket'])
def test_both_renderers_give_the_same_scores(context, mesh, scale):
    camera = Pinhole(237, 213, 720, 690, 120.5, 103.0)
    poses = random_poses(100, seed=3, depth=(0.35, 0.55), aside=0.06)
    edges = random_edges(camera, near=0.3, far=0.7)
    seen = scene(mesh, Window(11, 7, (200, 190)).coarser(scale), camera, 0.2, 0.8)
    sums = []
    for renderer in (GlRenderer(context), NumbaRenderer()):
        with renderer.contour_score(seen, edges, LARGEST) as score:
            sums.append(score.evaluate(poses))
    # Evidence of both signs is measured against the sum of its magnitudes, about 1 nat / px.
    off = np.abs(sums[1] - sums[0]) / sums[0][:, 1:]
    # On the same pixels they agree (`test_points_in_order_add_up_to_the_score`). In a pose of ten
    # one pixel on the border is one's alone, and with it a notch in a contour of a few hundred.
    assert np.quantile(off, 0.85) < 1e-4
    assert off.max() < 0.1


@pytest.mark.parametrize('profile', [CONTRAST, LARGEST])
def test_points_in_order_add_up_to_the_score(renderer, profile):
    seen = scene(bracket())
    edges = random_edges(NARROW)
    with renderer.contour_score(seen, edges, profile) as score:
        for pose in random_poses(6, seed=1, depth=(0.2, 0.3)):
            points = score.points(pose)
            evidence, length = score.evaluate(pose[None])[0]
            assert points.lengths @ points.evidence == pytest.approx(evidence, abs=1e-4 * length)
            assert points.lengths.sum() == pytest.approx(length, rel=1e-4)
            np.testing.assert_allclose(points.evidence, profile.evidence(points.energies))
            np.testing.assert_allclose(np.linalg.norm(points.normals, axis=1), 1, atol=1e-5)
            # Neighbours in a piece are neighbours in the image, and it is followed from its start.
            same = np.diff(points.piece) == 0
            steps = np.linalg.norm(np.diff(points.pixels, axis=0), axis=1)
            assert steps[same].max() <= 1.01
            assert (np.diff(points.along)[same] > 0).all()
            assert set(np.diff(points.piece)) <= {0, 1}
            # What hangs together is not torn: the silhouette is one loop.
            longest = np.bincount(points.piece, points.lengths).max()
            assert longest > 0.5 * length
        nothing = np.eye(4)
        nothing[:3, 3] = [5, 0, 0.3]
        assert len(score.points(nothing).piece) == 0


def test_points_of_a_ball_lie_on_its_outline():
    camera = Pinhole(237, 213, 720, 690, 120.5, 103.0)
    ball = trimesh.creation.icosphere(5, 0.05)
    pose = np.eye(4)
    pose[:3, 3] = [0.01, -0.005, 0.5]
    edges = random_edges(camera, near=0.3, far=0.7)
    seen = scene(ball, Window(0, 0, (237, 213)), camera, 0.3, 0.7)
    with NumbaRenderer().contour_score(seen, edges, CONTRAST) as score:
        points = score.points(pose)
    assert set(points.piece) == {0}
    # Rays that touch it make the same angle with that to its centre.
    rays = np.concatenate([(points.pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy],
                           np.ones((len(points.piece), 1))], axis=1)
    cosine = rays @ pose[:3, 3] / np.linalg.norm(rays, axis=1) / np.linalg.norm(pose[:3, 3])
    angle = np.arcsin(0.05 / np.linalg.norm(pose[:3, 3]))
    np.testing.assert_allclose(np.arccos(cosine), angle, atol=0.75 / 690)
    assert abs(np.arccos(cosine).mean() - angle) < 0.05 / 690
    outwards = points.pixels - camera.project(pose[None, :3, 3])[0]
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    assert (points.normals * outwards).sum(axis=1).min() > np.cos(0.3)
    assert points.lengths.sum() == pytest.approx(
        np.linalg.norm(np.diff(points.pixels[::7], axis=0), axis=1).sum(), rel=0.05)


def test_labels_that_begin_at_the_camera_leave_the_contour():
    camera = Pinhole(237, 213, 720, 690, 120.5, 103.0)
    pose = np.eye(4)
    pose[2, 3] = 0.5
    lengths = []
    for near in (0.3, 0.01, 0.001):
        edges = random_edges(camera, near=near, far=0.7)
        seen = scene(trimesh.creation.icosphere(4, 0.05), Window(0, 0, (237, 213)), camera, near,
                     0.7)
        with NumbaRenderer().contour_score(seen, edges, CONTRAST) as score:
            lengths.append(score.points(pose).lengths.sum())
    assert lengths[0] > 400
    assert lengths == pytest.approx([lengths[0]] * 3)


def test_scores_of_the_processor_do_not_depend_on_threads_or_batches(all_threads):
    poses = random_poses(50, seed=3, depth=(0.2, 0.4))
    with NumbaRenderer().contour_score(scene(bracket()), random_edges(NARROW), LARGEST) as score:
        together = score.evaluate(poses)
        backwards = score.evaluate(poses[::-1])[::-1]
        alone = np.concatenate([score.evaluate(pose[None]) for pose in poses])
        set_threads(1)
        one_thread = score.evaluate(poses)
    assert np.ptp(together) > 10
    for sums in (backwards, alone, one_thread):
        np.testing.assert_array_equal(sums, together)


def test_sums_are_the_same_in_every_run_and_batch_order(context):
    poses = random_poses(30, seed=6, depth=(0.2, 0.4))
    with GlContourScore(context, scene(bracket()), random_edges(NARROW), CONTRAST,
                        capacity=8) as score:
        first = score(poses)
        for _ in range(5):
            np.testing.assert_array_equal(score(poses), first)
        assert len(score(poses[:0])) == 0
    assert np.ptp(first) > 10


def test_a_contour_too_long_for_the_list_is_summed_all_the_same(renderer):
    # A fence of slats every 3 px, half as wide: several times the pairs that the GPU's list takes.
    camera = Pinhole(301, 290, 300, 300, 150, 145)
    slat = trimesh.creation.box((0.0015, 0.28, 0.0004))
    places = np.arange(-0.14, 0.14, 0.003)
    fence = trimesh.util.concatenate([slat.copy().apply_translation((x, 0, 0)) for x in places])
    window = Window(0, 0, (301, 290))
    pose = np.eye(4)
    pose[2, 3] = 0.3
    poses = np.stack([pose, pose])
    poses[1, :3, :3] = trimesh.transformations.rotation_matrix(0.3, [1, 2, 3])[:3, :3]
    edges = random_edges(camera)
    seen = scene(fence, window, camera, 0.1, 0.6)
    with renderer.contour_score(seen, edges, CONTRAST) as score:
        sums = score.evaluate(poses)
        np.testing.assert_array_equal(score.evaluate(poses), sums)
        depths = drawn(renderer, score, seen, poses)
    across = (depths[0] > 0) != (np.roll(depths[0], 1, axis=1) > 0)
    assert across.sum() > 2 * 6144
    for values, depth in zip(sums, depths, strict=True):
        expected = evidence(depth, window, edges, seen.model.radius)
        np.testing.assert_allclose(values, expected, rtol=1e-3, atol=1e-3 * expected[1])


def test_what_shows_no_contour_has_no_evidence(renderer):
    poses = random_poses(5, seed=0)
    poses[0, 0, 3] = 5
    poses[1, 2, 3] = -0.4
    poses[2, 0, 0] = np.nan
    poses[3, :3, 3] = [0, 0, 0.07]  # fills the image
    seen = scene(cup(), Window(25, 20, (20, 20)), NARROW, 0.01, 0.9)
    with renderer.contour_score(seen, random_edges(NARROW), CONTRAST) as score:
        np.testing.assert_array_equal(score.evaluate(poses)[:4], 0)


@pytest.mark.parametrize('shape', [(9, 3), (4, 10), (4, 1)])
def test_a_profile_that_is_too_large_is_refused(renderer, shape):
    offsets, knots = (np.arange(n, dtype=np.float32) for n in shape)
    profile = ContourProfile(offsets, knots, np.zeros(shape, np.float32))
    with pytest.raises(RenderError, match=f'{shape[0]} offsets and {shape[1]} knots'):
        renderer.contour_score(scene(cup()), random_edges(NARROW), profile)


def test_an_edge_volume_beyond_the_textures_of_this_gl_is_refused(context):
    most = context.limit('GL_MAX_3D_TEXTURE_SIZE')
    edges = EdgeVolume(Header(), np.zeros((57, 71, most + 1, 3), np.float32),
                       depth_labels(0.2, 0.5, most + 1), NARROW)
    with pytest.raises(RenderError, match=f'and {most + 1} labels is beyond'):
        GlContourScore(context, scene(cup(), Window(0, 0, (2, 2))), edges, CONTRAST)
