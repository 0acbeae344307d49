"""What the executive of the manipulation scenes does when a motion fails: the hand stays closed.

The robot is a stand-in: no pose of a real one makes just these motions fail.
"""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / 'examples'))
pick_from_water = pytest.importorskip('pick_from_water')

ABOVE = 0.8  # m


class Robot:
    """Plans all, and does what `done` says of a goal's height and of whether it is straight."""

    def __init__(self, done):
        self.done, self.closed = done, False

    def plan(self, *_):
        return True

    def move(self, _, goal, straight=False):
        return self.done(goal[2, 3], straight)

    def grip(self, close):
        self.closed = close
        return True

    def holds(self):
        return True


def executive(done, **options):
    made = pick_from_water.PickFromWater.__new__(pick_from_water.PickFromWater)
    made.robot = Robot(done)
    made.options = SimpleNamespace(**{'lift_only': False, 'lift': 0.2} | options)
    return made


def at(height):
    pose = np.eye(4)
    pose[2, 3] = height
    return pose


def test_above_the_tray_the_hand_stays_closed():
    made = executive(lambda _, straight: not straight)
    made.robot.closed = True
    with pytest.raises(pick_from_water.GivenUp, match='no way to the tray'):
        made.place([at(ABOVE), at(ABOVE)])
    assert made.robot.closed


def test_what_cannot_be_lifted_is_not_done():
    made = executive(lambda height, _: height < ABOVE + 0.1, lift_only=True)
    with pytest.raises(pick_from_water.GivenUp, match='no way up with the object'):
        made.pick(np.eye(4), [(at(ABOVE), at(ABOVE))])
    assert made.robot.closed
    made = executive(lambda height, _: height < ABOVE + 0.1, tray=(0, 0, ABOVE), gap=0, bottom=0)
    assert made.pick(at(ABOVE), [(at(ABOVE), at(ABOVE))])  # the tray is reached without it
    made = executive(lambda *_: True, lift_only=True)
    assert made.pick(np.eye(4), [(at(ABOVE), at(ABOVE))])
