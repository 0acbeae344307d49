"""The same seed gives the same pose bit for bit: in any process, whatever was compiled before."""

import os
import subprocess
import sys

_PROGRAM = """
import sys
import numpy as np
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evaluation.bench import pmcl as bench
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene
from pmcl_ros.runtime import kernel_threads
kernel_threads.set_threads(int(sys.argv[1]))
renderer, model, region = NumbaRenderer(), bench.vessel(), Region(bench.PLACE, (0.16,) * 3)
scene = Scene(model, bench.CAMERA, region.window(bench.CAMERA, model.radius),
              *region.grown(model.radius))
poses = bench.poses_beside(20)
noise = np.random.default_rng(0).random((328, 328, 8, 3), np.float32)
depths = depth_labels(scene.near, scene.far, 8)
edges = EdgeVolume(Header(), noise, depths, bench.CAMERA)
volume = DepthLikelihoodVolume(Header(), noise[..., 0].copy(), depths, bench.CAMERA)
results = [renderer.depths(scene, poses[:2])]
with renderer.contour_score(scene, edges, ContourProfile.learned()) as score:
    points = score.points(poses[1])
    results += [score.evaluate(poses), points.pixels, points.normals, points.energies]
with renderer.likelihood_score(scene, volume) as score:
    results.append(score(poses))
sys.stdout.buffer.write(b''.join(np.ascontiguousarray(each).tobytes() for each in results))
"""


def run(cache, threads):
    """The bytes of all scores, and what lies in the cache afterwards."""
    environment = os.environ | {'NUMBA_CACHE_DIR': str(cache), 'NUMBA_NUM_THREADS': str(threads)}
    found = subprocess.run([sys.executable, '-c', _PROGRAM, str(threads)], env=environment,
                           capture_output=True, check=True)
    return found.stdout, {path.name: path.stat().st_mtime_ns for path in cache.rglob('*.nbc')}


def test_scores_are_the_same_compiled_or_from_the_cache_and_by_any_number_of_threads(tmp_path):
    # Helpers once had copies that summed in other orders; what ran depended on the cache.
    compiled, files = run(tmp_path, 2)
    assert files
    cached, later = run(tmp_path, 1)
    assert later == files  # nothing was compiled again
    assert len(compiled) > 10 ** 4
    assert cached == compiled
