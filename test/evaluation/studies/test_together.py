"""What is counted of objects localised together, and the command that does it."""

import re

import numpy as np
from command_line import Runner
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.cli import main
from pmcl_ros.evaluation.studies.together import (
    Together,
    as_well_as,
    placed_as_well_as,
    rank,
    summary,
)
from pmcl_ros.evaluation.trials import Trial


def trial(mm, degrees, lost=False):
    return Trial('a, b', 'together', 0, translation_mm=mm, axis_deg=degrees, lost=lost)


TRIALS = st.builds(trial, st.floats(0, 100), st.floats(0, 170), st.booleans())


@given(TRIALS)
def test_everything_is_as_well_as_itself(one):
    assert as_well_as(one, one)
    assert placed_as_well_as(one, one)


@given(TRIALS, TRIALS)
def test_of_two_one_is_as_well_as_the_other(one, other):
    assert (as_well_as(one, other) or as_well_as(other, one)
            or rank(one) == rank(other) == 2)  # nearer, but turned
    if rank(one) > rank(other):
        assert not as_well_as(other, one)


def test_a_wrong_claim_is_worse_than_lost_and_lost_is_worse_than_found():
    right, lost, wrong = trial(3, 0.6), trial(3, 0.6, lost=True), trial(50, 0.6)
    assert as_well_as(right, lost)
    assert as_well_as(lost, wrong)
    assert not as_well_as(wrong, lost)
    assert not as_well_as(lost, right)
    assert placed_as_well_as(lost, right)
    assert as_well_as(trial(4.9, 2.5), right)
    assert not as_well_as(trial(5.1, 0.6), right)
    assert not as_well_as(trial(3, 2.9), right)


def test_the_table_counts():
    right, lost, wrong = trial(1, 0), trial(1, 0, lost=True), trial(50, 0)
    absent, claimed = (Trial('a, b', 'alone', 0, empty=True, lost=each) for each in (True, False))
    picture = np.zeros((1, 1, 3), np.uint8)
    text = summary([
        Together(1, 'a, b', False, 0.2, (right, right, absent), (lost, right, absent), 0.001, 2.0,
                 picture),
        Together(2, 'c, c', True, 0.3, (right, wrong, claimed), (right, right, absent), 0.003, 4.0,
                 picture)])
    assert '| 1 | a, b | 20 % | (1.0), 1.0 | 1.0, 1.0 | 2 of 2 | 1.0 mm | lost | 2 s |' in text
    assert '| 2 | c, c, two alike | 30 % | 1.0, 1.0 | 1.0, elsewhere | 1 of 2 |' in text
    assert 'together as alone: 75 % (3 of 4); where no two are alike: 100 % (2 of 2)' in text
    assert 'alone: found 75 % (3 of 4), lost 25 % (1 of 4), elsewhere 0 % (0 of 4)' in text
    assert '50 % (1 of 2) of scenes, the deepest 3.0 mm' in text
    assert 'reported as lost: 50 % (1 of 2), alone 100 % (2 of 2)' in text


def test_the_command_prints_a_row_for_each_scene(tmp_path):
    done = Runner().invoke(main, [
        'together', '--count', '1', '--seed', '1011', '--objects', '2', '--views', '3', '--size',
        '96', '--out', str(tmp_path)], catch_exceptions=False)
    assert done.exit_code == 0
    assert re.search(r'^\| 1011 \| .* of 2 \|', done.stdout, re.MULTILINE)
    assert (tmp_path / '001011.png').stat().st_size > 1000
    assert (tmp_path / 'results.md').read_text() == done.stdout
