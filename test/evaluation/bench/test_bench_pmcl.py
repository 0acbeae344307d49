"""The bench's plain form scores the same poses as what is timed, and as high."""

import numpy as np

from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evaluation.bench import pmcl as bench
from pmcl_ros.evaluation.bench.pmcl import PmclBench
from pmcl_ros.geometry.header import Header
from pmcl_ros.pmcl.render.gl_zbuffers import ZBuffers
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window


def test_the_plain_form_gives_the_same_scores(context):
    camera = bench.CAMERA
    scene = Scene(bench.vessel(), camera, Window(0, 0, (camera.width, camera.height)), 0.4, 0.7)
    values = np.random.default_rng(0).random((camera.height, camera.width, 20), np.float32)
    volume = DepthLikelihoodVolume(Header(), values, depth_labels(0.4, 0.7, 20), camera)
    poses = bench.poses_beside(6)
    with ZBuffers(context, scene, capacity=1) as zbuffers:
        plain = bench.plain_scores(zbuffers, volume, poses)
    with NumbaRenderer().likelihood_score(scene, volume) as score:
        np.testing.assert_allclose(score(poses), plain, rtol=1e-4)
    assert np.ptp(plain) > 1e-3
    # What is promised is told of a mesh of 2,000 faces that covers 9,000 pixels.
    assert 1900 < len(scene.model.faces) < 2100
    covered = (NumbaRenderer().depths(scene, poses) > 0).sum() / len(poses)
    assert 8000 < covered < 10_000


def test_what_is_printed():
    result = PmclBench('a glass', {'numba likelihood': 50.0}, {'proposals': 100.0}, 2.5, 20.0)
    lines = result.lines()
    assert lines[0] == 'a glass'
    assert '50 us a pose,     20000 poses a second' in lines[1]
    assert 'proposals:       100 ms' in lines[2]
    assert lines[3].endswith('likelihoods: 2.5 s by numba, 20 times as fast as the plain form')
