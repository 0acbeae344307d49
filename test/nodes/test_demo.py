"""`make demo CAMERA=simulated`: trigger, callback, download, views, volume, pose, in one run."""

import os
import re
import subprocess
import sys

import cv2
from harness import ROOT
from shipped_bag import NEAR, UPRIGHT


def test_a_simulated_camera_s_picture_becomes_a_pose(tmp_path):
    done = subprocess.run([sys.executable, '-m', 'pmcl_ros.nodes.demo', '--camera', 'simulated',
                           '--out', tmp_path], cwd=ROOT, capture_output=True, text=True,
                          check=False, env=os.environ | {'COLUMNS': '200'})
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'lytro_driver: published sha1-' in done.stdout
    found = re.search(r'error: ([\d.]+) mm, ([\d.]+) degrees', done.stdout)
    assert float(found[1]) < 1e3 * NEAR
    assert float(found[2]) < UPRIGHT
    for name in ('centre', 'depth', 'overlay'):
        assert cv2.imread(str(tmp_path / f'{name}.png')) is not None
