"""What trials say: causes of failures, rates, times."""

import numpy as np
import pytest

from pmcl_ros.evaluation.manipulation.findings import HEAD, causes, rows
from pmcl_ros.evaluation.manipulation.page import page
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.simulated_robot.trial import Grip, ManipulationTrial
from pmcl_ros.simulation.manipulation.workplace import OBJECTS

RIGHT = Grip(gap=0.07, held=True, off=(2.0, 1.0))
WRONG = Grip(gap=0.0, held=False, off=(25.0, 1.0))
TURNED = Grip(gap=0.07, held=True, off=(2.0, 90.0))


def trial(seed=0, **what):
    return ManipulationTrial(seed=seed, **({'place': 'sink', 'stands': True} | what))


@pytest.mark.parametrize(('what', 'cause'), [
    ({'done': True, 'grips': (RIGHT,)}, ''),
    ({'done': True, 'grips': (WRONG, RIGHT)}, ''),
    ({'done': True, 'grips': (RIGHT,), 'largest_touch': 11.0}, 'touched'),
    ({'grips': (WRONG,), 'said': 'pick_from_water: slip', 'status': 1}, 'wrong pose'),
    ({'grips': (TURNED,), 'status': 0}, 'wrong pose'),
    ({'grips': (RIGHT,), 'said': 'pick_from_water: slip', 'status': 1}, 'slip'),
    ({'grips': (RIGHT,), 'said': 'done', 'status': 0}, 'not upright'),
    ({'said': 'pick_from_water: not found after 6 views', 'status': 1}, 'not found'),
    ({'said': 'pick_from_water: not sure after 6 views', 'status': 1}, 'not sure'),
    ({'said': 'pick_from_water: no reachable grasp of 12', 'status': 1}, 'no reachable grasp'),
    ({'said': 'Traceback', 'status': 2}, 'program')])
def test_a_failure_has_one_cause(what, cause):
    assert trial(**what).cause == cause


def test_a_row_counts_the_trials_of_each_start():
    trials = [trial(1, done=True, grips=(RIGHT,), times={'to the grasp': 10.0}),
              trial(2, done=True, grips=(RIGHT,), times={'to the grasp': 20.0}),
              trial(3, stands=False, grips=(WRONG,), status=1, largest_touch=4.0)]
    found = [dict(zip(HEAD, each, strict=True)) for each in rows(trials)]
    assert [(each['trials'], each['of'], each['done']) for each in found] == [
        ('by what it sees, all', '3', '2'), ('by what it sees, standing', '2', '2'),
        ('by what it sees, lying', '1', '0')]
    assert found[0]['grasps at a wrong pose'] == '1'
    assert found[0]['rest to grasp, median [s]'] == '15.0'
    assert found[2]['rest to grasp, median [s]'] == ''
    assert [each['off at the grasp, median [mm]'] for each in found] == ['2.0', '2.0', '25.0']
    assert causes(trials) == ['wrong pose: 1 (seeds 3)']


def test_a_trial_is_read_back(tmp_path):
    path = tmp_path / 'trial.json'
    written = trial(7, grips=(RIGHT,), poses=((3.0, 1.0),), times={'physics': 2.0})
    path.write_text(written.model_dump_json())
    assert ManipulationTrial.read(path) == written


@pytest.mark.parametrize(('place', 'done', 'start'), [
    ('sink', 'upright on the tray', 'standing'), ('tank', 'held clear of the water', 'floating')])
def test_a_page_says_what_is_done_in_its_place(tmp_path, place, done, start):
    name, _ = OBJECTS[place]
    model = ObjectModel.load(resolve(f'package://pmcl_ros/config/objects/{name}.yaml', 'object'))
    water = Interface(np.array([[0.0, 0, 0.6]]), np.array([[0.0, 0, 1]]), 1.333)
    text = page('title', {}, [trial(3, place=place, done=True)], [], [tmp_path], model,
                Pinhole(64, 48, 60.0, 60.0, 31.5, 23.5), [water])
    assert f'Done is: {done}, and never touched' in text
    assert f'3: {start}, done' in text
