"""The contour score against the same in numpy, from z-buffers read back."""

import cv2
import numpy as np
import pytest
import trimesh
from pmcl_scenes import bracket, cup, random_poses
from scipy.ndimage import gaussian_filter, map_coordinates

from pmcl_ros.dlv.volume import EdgeVolume, depth_labels
from pmcl_ros.errors import RenderError
from pmcl_ros.header import Header
from pmcl_ros.lightfield.geometry import Pinhole
from pmcl_ros.pmcl.contour_score import ContourScore
from pmcl_ros.pmcl.zbuffers import Window, ZBuffers

NARROW = Pinhole(71, 57, 110, 95, 33.2, 30.6)
WIDE = Pinhole(97, 61, 40, 44, 50, 28)
WHOLE = Window(0, 0, (71, 57))


def random_edges(pinhole, labels=7, near=0.15, far=0.5, seed=0):
    """Positive semi-definite tensors that vary over a few pixels and labels."""
    rng = np.random.default_rng(seed)
    gradients = gaussian_filter(rng.normal(size=(pinhole.height, pinhole.width, labels, 2, 3)),
                                (1.5, 1.5, 0.7, 0, 0)) * 9
    gx, gy = gradients[..., 0, :], gradients[..., 1, :]
    tensor = np.stack([(gx * gx).sum(-1), (gy * gy).sum(-1), (gx * gy).sum(-1)], axis=-1)
    return EdgeVolume(Header(), tensor.astype(np.float32), depth_labels(near, far, labels),
                      pinhole)


def evidence(depth, window, edges, radius, blur):
    """Sum and length of what the module's docstring says, in double precision."""
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
    if blur:
        planes = [cv2.GaussianBlur(tensor[:, :, k], (0, 0), blur) for k in range(tensor.shape[2])]
        tensor = np.stack(planes, axis=2)

    def energy(distance):
        at = [image_y + distance * ny, image_x + distance * nx, label]
        xx, yy, xy = (map_coordinates(tensor[..., k], at, order=1, mode='nearest')
                      for k in range(3))
        return np.sqrt(np.maximum(xx * nx ** 2 + yy * ny ** 2 + 2 * xy * nx * ny, 0))

    step = max(1, blur)
    outside = np.mean([energy(step * k) for k in (3, 4.5, 6)], axis=0)
    pixels = window.scale / np.maximum(np.abs(nx) + np.abs(ny), 1e-9) * known
    return pixels @ (np.minimum(energy(0), 2) - np.minimum(outside, 2)), pixels.sum()


@pytest.mark.parametrize('blur', [0.0, 1.5])
@pytest.mark.parametrize(('camera', 'window'), [
    (NARROW, WHOLE), (NARROW, Window(13, 5, (40, 41))), (NARROW, Window(0, 0, (36, 29), 2)),
    (NARROW, Window(2, 1, (23, 18), 3)), (WIDE, Window(0, 0, (97, 61)))])
@pytest.mark.parametrize('mesh', [cup(), bracket()], ids=['cup', 'bracket'])
def test_evidence_is_the_definition(context, camera, window, mesh, blur):
    # Some nearer, some farther than the labels, some across the image's border.
    poses = random_poses(11, seed=4, depth=(0.14, 0.4), aside=0.2 if camera is WIDE else 0.06)
    radius = np.linalg.norm(mesh.vertices, axis=1).max()
    edges = random_edges(camera)
    with ZBuffers(context, mesh.vertices, mesh.faces, camera, window, 0.05, 0.5, closed=True,
                  capacity=11) as zbuffers, \
            ContourScore(zbuffers, edges, radius, blur) as score:
        sums = score.batch(poses)
        depths = zbuffers.read(len(poses)).astype(float)
    expected = np.array([evidence(depth, window, edges, radius, blur) for depth in depths])
    assert (expected[:, 1] > 15).sum() >= 8
    assert np.ptp(expected[:, 0]) > 10
    np.testing.assert_allclose(sums[:, 1], expected[:, 1], rtol=1e-3)
    # As evidence of either sign adds up, its error is measured against the length.
    assert (np.abs(sums[:, 0] - expected[:, 0]) <= 1e-3 * np.maximum(expected[:, 1], 1)).all()


def test_sums_are_the_same_in_every_run_and_batch_order(context):
    mesh = bracket()
    poses = random_poses(30, seed=6, depth=(0.2, 0.4))
    with ZBuffers(context, mesh.vertices, mesh.faces, NARROW, WHOLE, 0.1, 0.5, closed=True,
                  capacity=8) as zbuffers, \
            ContourScore(zbuffers, random_edges(NARROW), 0.05) as score:
        first = score(poses)
        for _ in range(5):
            np.testing.assert_array_equal(score(poses), first)
        assert len(score(poses[:0])) == 0
    assert np.ptp(first) > 10


def test_a_contour_too_long_for_the_list_is_summed_all_the_same(context):
    # A fence of slats every 3 px, half as wide: several times the pairs that the list takes.
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
    with ZBuffers(context, fence.vertices, fence.faces, camera, window, 0.1, 0.6, closed=True,
                  capacity=2) as zbuffers, ContourScore(zbuffers, edges, 0.2) as score:
        sums = score.batch(poses)
        depths = zbuffers.read(2).astype(float)
        np.testing.assert_array_equal(score.batch(poses), sums)
    across = (depths[0] > 0) != (np.roll(depths[0], 1, axis=1) > 0)
    assert across.sum() > 2 * 6144
    for seen, depth in zip(sums, depths, strict=True):
        expected = evidence(depth, window, edges, 0.2, 0)
        np.testing.assert_allclose(seen, expected, rtol=1e-3, atol=1e-3 * expected[1])


def test_what_shows_no_contour_has_no_evidence(context):
    mesh = cup()
    poses = random_poses(5, seed=0)
    poses[0, 0, 3] = 5
    poses[1, 2, 3] = -0.4
    poses[2, 0, 0] = np.nan
    poses[3, :3, 3] = [0, 0, 0.07]  # fills the image
    with ZBuffers(context, mesh.vertices, mesh.faces, NARROW, Window(25, 20, (20, 20)), 0.01, 0.9,
                  closed=True) as zbuffers, \
            ContourScore(zbuffers, random_edges(NARROW), 0.06) as score:
        sums = score.batch(poses)
    np.testing.assert_array_equal(sums[:4], 0)


def test_an_edge_volume_beyond_the_textures_of_this_gl_is_refused(context):
    most = context.limit('GL_MAX_3D_TEXTURE_SIZE')
    camera = Pinhole(most + 1, 2, 10, 10, 5, 0.5)
    edges = EdgeVolume(Header(), np.zeros((2, most + 1, 2, 3), np.float32),
                       depth_labels(0.2, 0.5, 2), camera)
    mesh = cup()
    with ZBuffers(context, mesh.vertices, mesh.faces, camera, Window(0, 0, (8, 2)), 0.1, 0.9,
                  closed=True) as zbuffers, \
            pytest.raises(RenderError, match=f'{most + 1}x2 pixels and 2 labels is beyond'):
        ContourScore(zbuffers, edges, 0.06)
