"""The example waits for a pose that is sure and has grasps, all of one capture."""

import subprocess
import sys

import numpy as np
import yaml
from grasped_captures import START, SURE, TURN, GraspedCaptures
from harness import ROOT, own_lines


def test_the_grasps_of_the_first_sure_pose_are_told_best_first(tmp_path, user):
    script = [sys.executable, str(ROOT / 'examples' / 'pick_when_sure.py'), '--sigma', '0.002']
    log = tmp_path / 'log'
    with log.open('w') as errors, subprocess.Popen(
            script, stdout=subprocess.PIPE, stderr=errors, text=True) as example:
        captures = GraspedCaptures(user)

        def until_told(text, *capture):
            captures.send_until(lambda: text in log.read_text(), *capture)

        until_told('3.0 mm, 1 grasps', (0.001, 0.001, 0.003), [TURN])  # not sure in z
        until_told('1.0 mm, 0 grasps', SURE, [])
        captures.send((0.0015, 0.001, 0.0011), [TURN], START)  # grasps of another capture
        until_told('1.9 mm, 2 grasps', (0.0015, 0.001, 0.0019), [TURN, np.eye(4)])
        first, second = yaml.safe_load(own_lines(example.stdout.read()))['grasps']
    assert example.returncode == 0
    assert '1.5 mm' not in log.read_text()
    goal = first['grasp']
    assert (goal['frame'], goal['position']) == ('base_link', [0.5, 0.1, 0.7])
    np.testing.assert_allclose(goal['orientation'], [0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    assert first['pre_grasp'] == goal | {'position': [0.4, 0.1, 0.7]}
    assert second['grasp'] == {'frame': 'base_link', 'position': [0, 0, 0],
                               'orientation': [0, 0, 0, 1]}
