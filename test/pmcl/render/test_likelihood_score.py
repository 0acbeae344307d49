"""The paper's score of both renderers against the same in numpy, from their own z-buffers."""

from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import bracket, cup, model_of, random_poses

from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.render.gl_renderer import GlLikelihoodScore, GlRenderer
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.runtime.errors import RenderError
from pmcl_ros.runtime.kernel_threads import set_threads

NARROW = Pinhole(71, 57, 110, 95, 33.2, 30.6)
WHOLE = Window(0, 0, (71, 57))
WIDE = Pinhole(97, 61, 40, 44, 50, 28)  # 100 degrees: a sphere off the axis is an ellipse


def random_volume(pinhole, near, far, labels, seed=0):
    values = np.random.default_rng(seed).random((pinhole.height, pinhole.width, labels))
    return DepthLikelihoodVolume(Header(), values.astype(np.float32),
                                 depth_labels(near, far, labels), pinhole)


@pytest.fixture(params=['gl', 'numba'])
def renderer(request):
    if request.param == 'numba':
        return NumbaRenderer()
    return GlRenderer(request.getfixturevalue('context'))


def scene(mesh, window=WHOLE, camera=NARROW, near=0.1, far=0.9):
    return Scene(model_of(mesh), camera, window, near, far)


def drawn(renderer, score, seen, poses):
    """(n, height, width) the depths that a score has just seen: its own, to the pixel."""
    if isinstance(renderer, NumbaRenderer):
        return renderer.depths(seen, poses).astype(float)
    inverse = score.zbuffers.closeness(len(poses)).astype(float)
    return np.divide(1, inverse, out=np.zeros_like(inverse), where=inverse > 0)


def mean_likelihood(depth, window, volume):
    """Section V of the paper: linear interpolation between labels, the mean of valid pixels."""
    y, x = np.nonzero(depth)
    if not len(y):
        return 0.0
    at = [first + window.scale * cell + (window.scale - 1) // 2
          for first, cell in ((window.top, y), (window.left, x))]
    rays = volume.likelihood[at[0], at[1]].astype(float)
    inverse = 1 / volume.depths
    values = [np.interp(1 / z, inverse, ray, left=0, right=0)
              for z, ray in zip(depth[y, x].astype(float), rays, strict=True)]
    return np.mean(values)


@pytest.mark.parametrize(('camera', 'window'), [
    (NARROW, Window(0, 0, (71, 57))), (NARROW, Window(13, 5, (40, 41))),
    (NARROW, Window(2, 1, (23, 18), 3)), (WIDE, Window(0, 0, (97, 61)))])
@pytest.mark.parametrize('mesh', [cup(), bracket()], ids=['cup', 'bracket'])
@pytest.mark.parametrize(('near', 'far', 'labels'), [(0.1, 0.9, 31), (0.24, 0.28, 5)])
def test_score_is_the_formula(renderer, camera, window, mesh, near, far, labels):
    poses = random_poses(23, seed=5, depth=(0.15, 0.35), aside=0.3 if camera is WIDE else 0.05)
    volume = random_volume(camera, near, far, labels)
    seen = scene(mesh, window, camera, 0.05, 0.5)
    with renderer.likelihood_score(seen, volume) as score:
        scores = score(poses)
        depths = drawn(renderer, score, seen, poses)
    expected = [mean_likelihood(depth, window, volume) for depth in depths]
    assert scores.shape == (23,)
    assert np.ptp(scores) > 0.02
    # A pixel whose depth is that of the last label may count or not.
    np.testing.assert_allclose(scores, expected, atol=1e-5 if labels == 31 else 1e-3)
    if labels == 31:
        assert 0.3 < np.median(scores) < 0.6
    else:
        assert np.median(scores) < 0.3  # most of the surface is beyond the labels


def test_a_silhouette_that_is_empty_or_unknown_scores_zero(renderer):
    mesh = cup()
    poses = random_poses(4, seed=0)
    poses[0, 0, 3] = 5
    poses[1, 2, 3] = -0.4
    poses[2, 0, 0] = np.nan
    volume = random_volume(NARROW, 0.1, 0.9, 9)
    with renderer.likelihood_score(scene(mesh), volume) as score:
        scores = score(poses)
        assert score(poses[:0]).shape == (0,)
    np.testing.assert_array_equal(scores[:3], 0)
    assert scores[3] > 0.2


def test_the_score_is_that_of_the_pose_whatever_the_batch(context):
    mesh = cup()
    poses = random_poses(40, seed=8)
    scores = []
    for capacity in (1, 7, 64):
        with GlLikelihoodScore(context, scene(mesh), random_volume(NARROW, 0.1, 0.9, 9),
                               capacity) as score:
            scores.append(score(poses))
    np.testing.assert_allclose(scores[1:], [scores[0]] * 2, atol=2e-3)  # a border pixel more


def test_a_volume_beyond_the_buffers_of_this_gl_is_refused(context):
    labels = context.limit('GL_MAX_SHADER_STORAGE_BLOCK_SIZE') // (4 * 57 * 71) + 1
    if labels > 50_000:
        pytest.skip('this GL takes whatever fits in memory')
    volume = replace(random_volume(NARROW, 0.1, 0.9, 3), depths=depth_labels(0.1, 0.9, labels),
                     likelihood=np.zeros((57, 71, labels), np.float32))
    with pytest.raises(RenderError, match=r'bytes, this GL holds .* at most; choose fewer'):
        GlLikelihoodScore(context, scene(cup()), volume)


@pytest.mark.parametrize('scale', [1, 2])
@pytest.mark.parametrize('mesh', [cup(), bracket()], ids=['cup', 'bracket'])
def test_both_renderers_give_the_same_scores(context, mesh, scale):
    camera = Pinhole(237, 213, 720, 690, 120.5, 103.0)
    poses = random_poses(100, seed=3, depth=(0.35, 0.55), aside=0.06)
    volume = random_volume(camera, 0.3, 0.7, 40)
    seen = scene(mesh, Window(11, 7, (200, 190)).coarser(scale), camera, 0.2, 0.8)
    scores = []
    for renderer in (GlRenderer(context), NumbaRenderer()):
        with renderer.likelihood_score(seen, volume) as score:
            scores.append(score(poses))
    off = np.abs(scores[1] / scores[0] - 1)
    # Few poses have a pixel on their border that is one's alone: a thousandth of what they cover.
    assert np.quantile(off, 0.8) < 1e-5
    assert off.max() < 1e-3


def test_scores_of_the_processor_do_not_depend_on_threads_or_batches(all_threads):
    poses = random_poses(50, seed=3)
    with NumbaRenderer().likelihood_score(scene(bracket()),
                                          random_volume(NARROW, 0.1, 0.9, 40)) as score:
        together = score(poses)
        backwards = score(poses[::-1])[::-1]
        alone = np.concatenate([score(pose[None]) for pose in poses])
        set_threads(1)
        one_thread = score(poses)
    assert np.ptp(together) > 0.01
    for scores in (backwards, alone, one_thread):
        np.testing.assert_array_equal(scores, together)
