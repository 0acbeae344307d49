"""A made-up sequence, replayed from its bag in step through real processes: every pose is compared
with the truth of its stamp; the hidden frames are told as lost, and the object is found again.
"""

import json
from typing import NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, PATIENCE, Process
from rclpy.qos import QoSProfile

from pmcl_ros.cli import main
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.messages import bags
from pmcl_ros.messages.pose import pose_from

ALL = QoSProfile(depth=100)
FRAMES, HIDDEN = 6, (2, 3)


@pytest.fixture(scope='module')
def sequence(tmp_path_factory):
    """The folder that the command writes: a vessel behind a film."""
    folder = tmp_path_factory.mktemp('sequence') / 'made'
    done = CliRunner().invoke(main, [
        'scenes', 'sequence', '--frames', str(FRAMES), '--occluded', str(len(HIDDEN)), '--size',
        '160', '--kind', 'film', '--seed', '0', '-o', str(folder)])
    assert done.exit_code == 0, done.output
    return folder


class Said(NamedTuple):
    """What pmcl_node said of a frame: its state, and where the object is, if it says so."""

    level: int
    mode: str
    spread: float  # mm
    pose: np.ndarray | None


class Chain:
    """dlv_node and pmcl_node, a process each, with the parameters that came with the sequence."""

    def __init__(self, folder, user, sequence):
        self._folder, self._user, self._sequence = folder, user, sequence
        self.truth = json.loads((sequence / 'truth.json').read_text())
        self.process = Process(
            folder, 'pmcl_ros.nodes.bringup', '--processes', '--params-file',
            sequence / 'parameters.yaml', '--without', 'lytro_driver', '--without',
            'subaperture_node', checked=False)

    def listen(self):
        self._states = self._user.listen(DiagnosticArray, '/diagnostics', ALL)
        self._poses = self._user.listen(PoseStamped, 'pose', ALL)

    def play(self, count):
        """Replay the views of so many frames; what was said of each of them, once all has come."""
        self._states.clear()
        self._poses.clear()
        stamps = [each['stamp_ns'] for each in self.truth['frames'][:count]]
        bag = self._folder / f'first {count}'
        bags.record(bag, [each for each in bags.read(self._sequence / 'bag')
                          if each.time_ns <= stamps[-1]])
        # nobody asks for the camera's poses
        with Process(self._folder, 'pmcl_ros.nodes.replay', bag, '--in-step', '--rate', 100,
                     '--timeout', PATIENCE, '--preset', 'views') as player:
            self._user.wait(lambda: not player.alive(), 'the end of the bag')
        return [self._said(each) for each in stamps]

    def again(self, **values):
        """Set parameters of pmcl_node, by which it is configured anew."""
        assert all(self._user.change('pmcl_node', DEACTIVATE, CLEANUP))
        assert self._user.set('pmcl_node', **values) == []
        assert all(self._user.change('pmcl_node', CONFIGURE, ACTIVATE)), self.process.log

    def _said(self, stamp):
        def told():
            return [state for each in self._states for state in each.status
                    if state.name == 'pmcl_node' and f'in capture {stamp}' in state.message]

        state = self._user.wait(told, f'what is said of {stamp}')[0]
        if state.level == DiagnosticStatus.OK:
            self._user.wait(lambda: stamp in self._stamps(), f'the pose of {stamp}')
        poses = [pose for header, pose in map(pose_from, self._poses)
                 if header.stamp_ns == stamp]
        assert len(poses) <= 1  # of a capture one pose is published, once
        values = {each.key: each.value for each in state.values}
        return Said(ord(state.level), values['mode'],
                    float(values.get('standard deviation [mm]', 'nan')), *(poses or [None]))

    def _stamps(self):
        return [pose_from(each)[0].stamp_ns for each in self._poses]


def check(chain, said):
    """A pose of each frame that shows the object, near the truth of its stamp, and no other."""
    assert [each['occluded'] for each in chain.truth['frames']] == [
        number in HIDDEN for number in range(FRAMES)]
    found = [number for number in range(len(said)) if number not in HIDDEN]
    assert [number for number, each in enumerate(said) if each.pose is not None] == found
    ok, warn = ord(DiagnosticStatus.OK), ord(DiagnosticStatus.WARN)
    assert [each.level for each in said] == [warn if number in HIDDEN else ok
                                             for number in range(len(said))]
    symmetry = Symmetry(np.array(chain.truth['symmetry_continuous']['axis']))
    for number in found:
        true = np.array(chain.truth['frames'][number]['object_to_camera'])
        error = pose_error(said[number].pose, true, symmetry)
        assert error.translation < 0.01
        assert np.degrees(error.rotation) < 5


def test_a_replayed_sequence_is_followed_lost_and_found_again(tmp_path, user, sequence):
    chain = Chain(tmp_path, user, sequence)
    with chain.process:
        chain.listen()
        said = chain.play(FRAMES)
        check(chain, said)
        assert [each.mode for each in said] == [
            'default', 'followed', *['predicted'] * len(HIDDEN), 'default', 'followed']
        spread = [each.spread for each in said]
        hidden = slice(HIDDEN[0] - 1, HIDDEN[-1] + 1)  # with the last that was seen
        assert (np.diff(spread[hidden]) > 0).all()
        assert max(spread[HIDDEN[-1] + 1:]) < spread[HIDDEN[0]]

        chain.again(tracking='none')
        said = chain.play(HIDDEN[0] + 1)
        check(chain, said)
        assert {each.mode for each in said} == {'default'}
    assert 'dropped' not in chain.process.log
