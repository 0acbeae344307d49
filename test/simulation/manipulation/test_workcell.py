"""The simulated arm at its workplaces: physics, feel, and whole tasks with the true pose."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.grasps.grasp import GraspFile
from pmcl_ros.grasps.ranking import Ranker
from pmcl_ros.grasps.settings import GraspSettings
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import SimulationError
from pmcl_ros.simulation.manipulation import physics
from pmcl_ros.simulation.manipulation.fetch_arm import HOME
from pmcl_ros.simulation.manipulation.physics import MotionError
from pmcl_ros.simulation.manipulation.pick_and_place import (
    CLEAR,
    Outcome,
    Sight,
    back,
    pick_and_place,
    raised,
)
from pmcl_ros.simulation.manipulation.workcell import Workcell
from pmcl_ros.simulation.manipulation.workplace import OBJECTS, draw_task

FOLDER = Path(__file__).parents[3] / 'config' / 'objects'
SHOULDER = 0.033, 0.0, 1.086
STANDS, LIES = 0, 1  # seeds of a sink
DOWN = np.array([[0, 0, 1.0, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])


class Bench:
    """A place, its object, and what is known about it."""

    def __init__(self, kind, seed):
        name, mass = OBJECTS[kind]
        self.model, gripper, grasps = GraspFile.read(FOLDER / f'{name}.grasps.yaml')
        self.ranker = Ranker(self.model, gripper, grasps, GraspSettings(shoulder=SHOULDER))
        rng = np.random.default_rng(seed)
        self.task = draw_task(rng, kind, self.model)
        self.cell = Workcell(self.task, self.model, mass, rng)

    def look(self):
        pose = self.cell.object_pose
        return Sight(pose, self.ranker.rank(pose, np.diag([1e-6] * 6)).candidates)

    def above(self, height):
        """gripper_link a height above the object's origin, pointing down."""
        goal = DOWN.copy()
        goal[:3, 3] = self.cell.object_pose[:3, 3]
        return raised(goal, height)

    @property
    def lowest(self):
        pose = self.cell.object_pose
        return (self.model.vertices @ pose[2, :3]).min() + pose[2, 3]


@pytest.mark.parametrize('seed', [STANDS, LIES])
def test_a_glass_gets_from_the_sink_onto_the_tray(seed):
    bench = Bench('sink', seed)
    assert bench.task.stands == (seed == STANDS)
    assert pick_and_place(bench.cell, bench.model, bench.look) == Outcome(True, True, '', 0.0)
    x, y, z = bench.task.place.tray
    pose = bench.cell.object_pose
    assert pose[:2, 3] == pytest.approx([x, y], abs=0.01)
    assert bench.lowest == pytest.approx(z, abs=1e-3)
    assert pose[2, 2] > np.cos(np.radians(1))


def test_a_bottle_gets_out_of_the_tank():
    bench = Bench('tank', 0)
    outcome = pick_and_place(bench.cell, bench.model, bench.look)
    assert outcome == Outcome(True, True, '', 0.0)
    assert bench.cell.held
    assert bench.lowest > bench.task.place.level + CLEAR


def test_a_slip_is_tried_again_once():
    bench = Bench('sink', STANDS)
    asked = []

    def first_beside():
        """The first time, the glass is said to be where the fingers close on nothing."""
        asked.append(1)
        sight = bench.look()
        if len(asked) > 1:
            return sight
        aside = np.array([0, 0.2, 0.0])
        wrong = sight.pose.copy()
        wrong[:3, 3] += aside if bench.cell.object_pose[1, 3] < 0 else -aside
        return Sight(wrong, bench.ranker.rank(wrong, np.diag([1e-6] * 6)).candidates)

    assert pick_and_place(bench.cell, bench.model, first_beside).placed
    assert len(asked) == 2


def test_things_rest_where_they_are():
    bench = Bench('sink', LIES)
    bench.cell.wait(0.5)  # it is drawn on its rim, and lies down
    start = bench.cell.object_pose
    bench.cell.wait(1.0)
    assert bench.cell.object_pose[:3, 3] == pytest.approx(start[:3, 3], abs=2e-4)
    assert bench.cell.joints == pytest.approx(HOME, abs=1e-4)
    assert bench.cell.time == pytest.approx(1.5)
    assert not bench.cell.standing_on_tray


@pytest.mark.parametrize(('angle', 'stands'), [(180, True), (90, False)])
def test_a_block_stands_on_either_end(angle, stands):
    model = ObjectModel.load(FOLDER / 'block.yaml')
    task = draw_task(np.random.default_rng(STANDS), 'sink', model)
    turn = Rotation.from_euler('x', angle, degrees=True)
    lowest = (model.vertices @ turn.as_matrix()[2]).min()
    cell = Workcell(replace(task, pose=pose_of(turn, task.place.tray - np.array(
        [0, 0, lowest - 1e-4]))), model, 0.2)
    cell.wait(0.5)
    assert cell.standing_on_tray == stands


def test_a_bottle_floats_upright_and_drifts_slowly():
    bench = Bench('tank', 1)
    bench.cell.wait(1.0)
    places = []
    for _ in range(5):
        places.append(bench.cell.object_pose[:3, 3])
        bench.cell.wait(1.0)
    assert bench.cell.object_pose[2, 2] > np.cos(np.radians(2))
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert 1e-4 < steps.max() < 0.011
    assert places[-1][2] == pytest.approx(bench.task.pose[2, 3], abs=0.005)


def test_the_arm_goes_where_it_is_told():
    bench = Bench('sink', STANDS)
    cell, goal = bench.cell, bench.above(0.25)
    tip = np.eye(4)
    tip[:3, 3] = 0.02, 0, 0.08
    cell.move(goal, tip=tip, avoid=cell.object_pose)
    assert cell.tool @ tip == pytest.approx(goal, abs=1e-3)
    assert cell.forward(cell.joints) == pytest.approx(cell.tool, abs=1e-4)
    cell.move(raised(cell.tool, 0.05), straight=True)
    assert (cell.tool @ tip)[:3, 3] == pytest.approx(raised(goal, 0.05)[:3, 3], abs=1e-3)
    assert cell.largest_touch == 0


def test_what_cannot_be_reached_is_refused_in_one_line():
    bench = Bench('sink', STANDS)
    cell, before = bench.cell, bench.cell.joints
    far = bench.above(0.3)
    far[0, 3] += 1.0
    with pytest.raises(MotionError, match='no inverse kinematics for gripper at'):
        cell.move(far)
    with pytest.raises(MotionError, match='is blocked by floor'):
        cell.move(bench.above(-0.02))
    with pytest.raises(MotionError, match='is blocked by object_0'):
        cell.move(bench.above(0.1), avoid=cell.object_pose)
    assert not cell.postures(far)
    assert cell.postures(bench.above(0.3))
    assert cell.time == 0
    assert np.array_equal(cell.joints, before)


def test_the_arm_keeps_away_from_where_the_object_is_believed_to_be():
    bench = Bench('sink', STANDS)
    goal = bench.above(0.1)
    believed = bench.cell.object_pose
    assert not bench.cell.postures(goal, avoid=believed)
    believed[1, 3] -= np.sign(believed[1, 3]) * 0.2
    assert bench.cell.postures(goal, avoid=believed)


def test_a_push_is_felt_until_the_fingers_close():
    bench = Bench('sink', STANDS)
    cell = bench.cell
    cell.move(bench.above(0.3))
    assert cell.largest_touch == 0
    cell.move(bench.above(0.055), straight=True)  # the palm comes down on the rim
    assert cell.largest_touch > 10
    felt = cell.largest_touch
    cell.grip(close=True)
    assert cell.largest_touch == felt


def test_the_gap_is_what_is_between_the_fingers():
    bench = Bench('sink', STANDS)
    cell = bench.cell
    assert cell.grip(close=True) == pytest.approx(0, abs=1e-3)
    assert not cell.held
    assert cell.grip(close=False) == pytest.approx(0.1, abs=1e-3)
    candidate = next(each for each in bench.look().candidates if each.grasp.name == 'over_top')
    cell.move(back(candidate.pose, 0.1))
    cell.move(candidate.pose, straight=True)
    assert cell.grip(close=True) == pytest.approx(0.072, abs=1e-3)
    assert cell.held


def test_a_film_shows_what_moves():
    bench = Bench('sink', STANDS)
    film, states = bench.cell.film((80, 60)), []
    bench.cell.watch = lambda: states.append(film.state())
    bench.cell.wait(0.5)
    still = len(states)
    bench.cell.move(bench.above(0.25))
    first, rest, last = (film.picture(states[k]) for k in (0, still - 1, -1))
    strip = film.strip(states)
    film.close()
    assert still == 5
    assert first.shape == (60, 80, 3)
    assert np.array_equal(first, rest)
    assert (first != last).any(axis=-1).mean() > 0.01
    assert strip.shape == (2 * 60, 4 * 80, 3)
    assert np.array_equal(strip[:60, :80], first)
    assert np.array_equal(strip[60:, -80:], last)


@pytest.mark.parametrize('library', ['mujoco', 'mink'])
def test_a_missing_library_is_told_with_its_remedy(monkeypatch, library):
    monkeypatch.setitem(sys.modules, library, None)
    wanted = getattr(physics, library)
    wanted.cache_clear()
    with pytest.raises(SimulationError, match=r"pip install 'pmcl_ros\[manipulate\]'"):
        wanted()
