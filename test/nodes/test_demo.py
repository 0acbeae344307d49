"""`make demo CAMERA=simulated`: trigger, callback, download, views, volume, pose, in one run."""

import re
import subprocess
import sys

import cv2
from harness import ROOT
from only_required import environment
from shipped_bag import NEAR, UPRIGHT


def test_a_simulated_camera_s_picture_becomes_a_pose(tmp_path):
    needed = environment(tmp_path / 'needed', 'requirements.txt', 'requirements-ros.txt')
    done = subprocess.run([sys.executable, '-m', 'pmcl_ros.nodes.demo', '--camera', 'simulated',
                           '--out', tmp_path / 'out'], cwd=ROOT, capture_output=True, text=True,
                          check=False, env=needed | {'COLUMNS': '200'})
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'lytro_driver: published sha1-' in done.stdout
    found = re.search(r'error: ([\d.]+) mm, ([\d.]+) degrees', done.stdout)
    assert float(found[1]) < 1e3 * NEAR
    assert float(found[2]) < UPRIGHT
    for name in ('centre', 'depth', 'overlay'):
        assert cv2.imread(str(tmp_path / 'out' / f'{name}.png')) is not None
