"""The example waits for a pose that is sure and has grasps, all of one capture."""

import subprocess
import sys
import time

import numpy as np
import yaml
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from harness import ROOT

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import estimate_to_messages, poses_to_messages
from pmcl_ros.nodes.runtime.base import SMALL
from pmcl_ros.pmcl.estimate import PoseEstimate

SECOND, START = 10**9, 1_700_000_000 * 10**9
BACK = np.zeros((4, 4))
BACK[0, 3] = -0.1  # m
TURN = np.array([[0.0, -1, 0, 0.5], [1, 0, 0, 0.1], [0, 0, 1, 0.7], [0, 0, 0, 1]])


def test_the_first_sure_pose_with_grasps_is_picked(tmp_path, user):
    script = [sys.executable, str(ROOT / 'examples' / 'pick_when_sure.py'), '--sigma', '0.002',
              '--object', 'glass']
    log = tmp_path / 'log'
    with log.open('w') as errors, subprocess.Popen(
            script, stdout=subprocess.PIPE, stderr=errors, text=True) as example:
        spreads, before, there = (
            user.node.create_publisher(kind, topic, SMALL) for kind, topic in (
                (PoseWithCovarianceStamped, 'pose_with_covariance'), (PoseArray, 'pre_grasps'),
                (PoseArray, 'grasps')))
        stamps = iter(range(START, START + 1000 * SECOND, SECOND))

        def until_told(text, *capture):
            """Publish it until it is received: DDS may tell the example of a publisher late."""
            while text not in log.read_text():
                send(next(stamps), *capture)
                until = time.monotonic() + 0.5
                user.wait(lambda until=until: text in log.read_text() or time.monotonic() > until,
                          text)

        def send(stamp, sigmas, grasps, grasped=None):
            """A capture's messages; grasped: the stamp of its grasps, where it is another."""
            estimate = PoseEstimate(Header(stamp, 'base_link'), np.eye(4),
                                    np.diag(np.square([*sigmas, 1, 1, 1])), np.eye(4)[None],
                                    np.zeros(1), 1.0, False, 'default')
            spreads.publish(estimate_to_messages(estimate).with_covariance)
            header = header_to_message(Header(grasped or stamp, 'base_link'))
            for publisher, shift in ((before, BACK), (there, np.zeros((4, 4)))):
                publisher.publish(PoseArray(header=header, poses=(
                    poses_to_messages(np.stack(grasps) + shift) if grasps else [])))

        until_told('3.0 mm, 1 grasps', (0.001, 0.001, 0.003), [TURN])  # not sure in z
        until_told('1.0 mm, 0 grasps', (0.001, 0.001, 0.001), [])
        send(next(stamps), (0.0015, 0.001, 0.0011), [TURN], START)  # grasps of another capture
        until_told('1.9 mm, 2 grasps', (0.0015, 0.001, 0.0019), [TURN, np.eye(4)])
        stages = yaml.safe_load(example.stdout.read())['stages']
    assert example.returncode == 0
    assert '1.5 mm' not in log.read_text()
    assert [next(iter(each)) for each in stages] == [
        'Connect', 'ComputeIK', 'ModifyPlanningScene', 'MoveTo', 'MoveTo', 'ModifyPlanningScene',
        'MoveRelative']
    goal = stages[3]['MoveTo']['goal']
    assert (goal['frame'], goal['position']) == ('base_link', [0.5, 0.1, 0.7])
    np.testing.assert_allclose(goal['orientation'], [0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    assert stages[1]['ComputeIK']['GeneratePose']['position'] == [0.4, 0.1, 0.7]
    assert stages[5]['ModifyPlanningScene']['attach_object'] == ['glass', 'wrist_roll_link']
