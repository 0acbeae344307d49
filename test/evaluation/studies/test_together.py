"""What is counted of objects localised together, and the command that does it."""

import re

import numpy as np
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.cli import main
from pmcl_ros.evaluation.studies.together import Found, Together
from pmcl_ros.evaluation.studies.together_table import table

FOUND = st.builds(Found, st.floats(0, 0.1), st.floats(0, 3), st.booleans())


@given(FOUND)
def test_everything_is_as_well_as_itself(one):
    assert one.as_well_as(one)
    assert one.placed_as_well_as(one)


@given(FOUND, FOUND)
def test_of_two_one_is_as_well_as_the_other(one, other):
    assert (one.as_well_as(other) or other.as_well_as(one)
            or one.rank == other.rank == 2)  # nearer, but turned
    if one.rank > other.rank:
        assert not other.as_well_as(one)


def test_what_is_said_to_be_elsewhere_is_worse_than_lost_and_that_than_found():
    right, lost = Found(0.003, 0.01, False), Found(0.003, 0.01, True)
    wrong = Found(0.05, 0.01, False)
    assert right.as_well_as(lost)
    assert lost.as_well_as(wrong)
    assert not wrong.as_well_as(lost)
    assert not lost.as_well_as(right)
    assert lost.placed_as_well_as(right)
    assert Found(0.0049, 0.04, False).as_well_as(right)
    assert not Found(0.0051, 0.01, False).as_well_as(right)
    assert not Found(0.003, 0.05, False).as_well_as(right)


def test_the_table_counts():
    right, lost, wrong = (Found(0.001, 0, False), Found(0.001, 0, True), Found(0.05, 0, False))
    picture = np.zeros((1, 1, 3), np.uint8)
    told = table([
        Together(1, 'a, b', False, 0.2, (right, right), (lost, right), 0.001, True, True, 2.0,
                 picture),
        Together(2, 'c, c', True, 0.3, (right, wrong), (right, right), 0.003, False, True, 4.0,
                 picture)])
    assert '| 1 | a, b | 20 % | (1.0), 1.0 | 1.0, 1.0 | 2 of 2 | 1.0 mm | lost | 2 s |' in told
    assert '| 2 | c, c, two alike | 30 % | 1.0, 1.0 | 1.0, elsewhere | 1 of 2 |' in told
    assert 'together as alone: 75 % (3 of 4); where no two are alike: 100 % (2 of 2)' in told
    assert 'alone: found 75 % (3 of 4), lost 25 % (1 of 4), elsewhere 0 % (0 of 4)' in told
    assert '50 % (1 of 2) of scenes, the deepest 3.0 mm' in told
    assert 'told lost: 50 % (1 of 2), alone 100 % (2 of 2)' in told


def test_the_command_prints_a_row_for_each_scene(tmp_path):
    done = CliRunner().invoke(main, [
        'together', '--count', '1', '--seed', '1011', '--objects', '2', '--views', '3', '--size',
        '96', '--out', str(tmp_path)], catch_exceptions=False)
    assert done.exit_code == 0
    assert re.search(r'^\| 1011 \| .* of 2 \|', done.stdout, re.MULTILINE)
    assert (tmp_path / '001011.png').stat().st_size > 1000
    assert (tmp_path / 'results.md').read_text() == done.stdout
