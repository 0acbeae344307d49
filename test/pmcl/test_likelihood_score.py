"""The paper's score against the same in numpy, from z-buffers read back."""

from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import bracket, cup, random_poses

from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.errors import RenderError
from pmcl_ros.header import Header
from pmcl_ros.lightfield.geometry import Pinhole
from pmcl_ros.pmcl.likelihood_score import LikelihoodScore
from pmcl_ros.pmcl.zbuffers import Window, ZBuffers

NARROW = Pinhole(71, 57, 110, 95, 33.2, 30.6)
WIDE = Pinhole(97, 61, 40, 44, 50, 28)  # 100 degrees: a sphere off the axis is an ellipse


def random_volume(pinhole, near, far, labels, seed=0):
    values = np.random.default_rng(seed).random((pinhole.height, pinhole.width, labels))
    return DepthLikelihoodVolume(Header(), values.astype(np.float32),
                                 depth_labels(near, far, labels), pinhole)


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
def test_score_is_the_formula(context, camera, window, mesh, near, far, labels):
    poses = random_poses(23, seed=5, depth=(0.15, 0.35), aside=0.3 if camera is WIDE else 0.05)
    volume = random_volume(camera, near, far, labels)
    with ZBuffers(context, mesh.vertices, mesh.faces, camera, window, 0.05, 0.5, closed=True,
                  capacity=9) as zbuffers, LikelihoodScore(zbuffers, volume) as score:
        scores = score(poses)
        expected = []
        for pose in poses:
            zbuffers.draw(pose[None])
            expected.append(mean_likelihood(zbuffers.read(1)[0], window, volume))
    assert scores.shape == (23,)
    assert np.ptp(scores) > 0.02
    # A pixel whose depth is that of the last label may count or not.
    np.testing.assert_allclose(scores, expected, atol=1e-5 if labels == 31 else 1e-3)
    if labels == 31:
        assert 0.3 < np.median(scores) < 0.6
    else:
        assert np.median(scores) < 0.3  # most of the surface is beyond the labels


def test_a_silhouette_that_is_empty_or_unknown_scores_zero(context):
    mesh = cup()
    poses = random_poses(4, seed=0)
    poses[0, 0, 3] = 5
    poses[1, 2, 3] = -0.4
    poses[2, 0, 0] = np.nan
    volume = random_volume(NARROW, 0.1, 0.9, 9)
    with ZBuffers(context, mesh.vertices, mesh.faces, NARROW, Window(0, 0, (71, 57)), 0.1, 0.9,
                  closed=True) as zbuffers, LikelihoodScore(zbuffers, volume) as score:
        scores = score(poses)
        assert score(poses[:0]).shape == (0,)
    np.testing.assert_array_equal(scores[:3], 0)
    assert scores[3] > 0.2


def test_the_score_is_that_of_the_pose_whatever_the_batch(context):
    mesh = cup()
    poses = random_poses(40, seed=8)
    scores = []
    for capacity in (1, 7, 64):
        with ZBuffers(context, mesh.vertices, mesh.faces, NARROW, Window(0, 0, (71, 57)), 0.1,
                      0.9, closed=True, capacity=capacity) as zbuffers, \
                LikelihoodScore(zbuffers, random_volume(NARROW, 0.1, 0.9, 9)) as score:
            scores.append(score(poses))
    np.testing.assert_allclose(scores[1:], [scores[0]] * 2, atol=2e-3)  # a border pixel more


def test_a_volume_beyond_the_buffers_of_this_gl_is_refused(context):
    labels = context.limit('GL_MAX_SHADER_STORAGE_BLOCK_SIZE') // (4 * 57 * 71) + 1
    if labels > 50_000:
        pytest.skip('this GL takes whatever fits in memory')
    volume = replace(random_volume(NARROW, 0.1, 0.9, 3), depths=depth_labels(0.1, 0.9, labels),
                     likelihood=np.zeros((57, 71, labels), np.float32))
    mesh = cup()
    with ZBuffers(context, mesh.vertices, mesh.faces, NARROW, Window(0, 0, (71, 57)), 0.1, 0.9,
                  closed=True) as zbuffers, \
            pytest.raises(RenderError, match=r'bytes, this GL holds .* at most; choose fewer'):
        LikelihoodScore(zbuffers, volume)
