"""The example's task has an alternative for each grasp; MoveIt itself is not on PyPI."""

import subprocess
import sys
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseStamped
from harness import ROOT
from std_msgs.msg import Header

EXAMPLES = ROOT / 'examples'


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    import pick_by_task_constructor
    return pick_by_task_constructor


@pytest.fixture
def ranked():
    """Two grasps: from the side, and from above."""
    def stamped(*place):
        x, y, z = map(float, place)
        return PoseStamped(header=Header(frame_id='base_link'),
                           pose=Pose(position=Point(x=x, y=y, z=z)))
    return [(stamped(0.4, 0, 0.7), stamped(0.5, 0, 0.7)),
            (stamped(0.5, 0.1, 1.0), stamped(0.5, 0.1, 0.8))]


def test_each_grasp_is_an_alternative_with_its_way(example, ranked):
    first, second = example.alternatives(ranked)
    assert (first['name'], second['name']) == ('grasp 1', 'grasp 2')
    assert (first['pose'], second['pose']) == (ranked[0][1], ranked[1][1])
    assert (first['distance'], second['distance']) == pytest.approx((0.1, 0.2))
    np.testing.assert_allclose([first['direction'], second['direction']],
                               [[1, 0, 0], [0, 0, -1]], atol=1e-12)


class Made:
    """In the place of an object of MoveIt's: keeps its arguments, attributes and calls."""

    def __init__(self, kind, *arguments):
        self.kind, self.arguments, self.calls = kind, arguments, []

    def __getattr__(self, name):
        if name == 'properties':
            self.properties = Made('Properties')
            return self.properties
        return lambda *arguments: self.calls.append((name, *arguments))

    def __getitem__(self, name):
        return next(each for each in self.parts() if each.arguments[0] == name)

    def parts(self):
        return [each for name, each in self.calls if name in ('add', 'insert')]


class Kinds:
    """In the place of a module of MoveIt's."""

    Stage = SimpleNamespace(PropertyInitializerSource=SimpleNamespace(INTERFACE='interface'))

    def __getattr__(self, name):
        return lambda *arguments: Made(name, *arguments)


def test_the_stages_of_the_task(example, ranked):
    options = SimpleNamespace(object='glass', group='arm', link='wrist', hand='gripper',
                              open='open', close='close', touch=['finger'], support='', lift=0.1)
    make = example.PickTask(Kinds(), Kinds(), 'node', options)
    task = make.task(example.alternatives(ranked))
    *before, choice = task.parts()
    assert [each.kind for each in before] == ['CurrentState', 'MoveTo', 'Connect']
    assert [each.arguments for each in choice.parts()] == [('grasp 1',), ('grasp 2',)]
    for each, (_, grasp) in zip(choice.parts(), ranked, strict=True):
        approach, reach, touch, _, hold, lift = each.parts()
        assert [part.kind for part in each.parts()] == [
            'MoveRelative', 'ComputeIK', 'ModifyPlanningScene', 'MoveTo', 'ModifyPlanningScene',
            'MoveRelative']
        pose = reach.arguments[1]
        assert (pose.kind, pose.pose) == ('GeneratePose', grasp)
        assert pose.calls == [('setMonitoredStage', before[1])]
        assert approach.max_distance == pytest.approx(0.1 if each is choice.parts()[0] else 0.2)
        assert touch.calls == [('allowCollisions', 'glass', ['finger'])]
        assert hold.calls == [('attachObject', 'glass', 'wrist')]
        assert lift.calls[0][1].vector.z == 1


@pytest.mark.skipif(find_spec('moveit') is not None, reason='MoveIt is there')
def test_without_moveit_it_says_what_to_install():
    done = subprocess.run([sys.executable, str(EXAMPLES / 'pick_by_task_constructor.py')],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 2
    line, = done.stderr.splitlines()
    assert 'ros-jazzy-moveit-task-constructor-core' in line
