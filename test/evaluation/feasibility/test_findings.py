"""What is said of simulated scenes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from runs import MODEL

from pmcl_ros.evaluation.feasibility import findings
from pmcl_ros.evaluation.feasibility.findings import (
    Aim,
    causes,
    good_enough,
    recommendation,
    share_text,
    success,
    worst,
)
from pmcl_ros.evaluation.feasibility.page import Feasibility
from pmcl_ros.evaluation.feasibility.view_sets import ViewSet, view_sets
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.simulation.camera_plan import CameraPlan

ONE, THREE = ViewSet('one view', (1,)), ViewSet('three views over 30 degrees', (0, 1, 2))


def trial(seed: int, mm: float = 1.0, degrees: float = 1.0, capture: str = 'table: glass',
          gap: float = 0.0, distance: float = 0.5, **other: Any) -> Trial:
    extra = {'across_mm': mm / 2, 'gap': gap, 'distance': distance}
    return Trial(capture, 'mode', seed, translation_mm=mm, axis_deg=degrees, ray_mm=mm / 2,
                 extra=extra, **other)


def test_sets_are_one_two_and_more_views_of_a_plan() -> None:
    assert [(each.name, each.pictures) for each in view_sets(CameraPlan(arc=(3, 30.0)))] == [
        ('one view', (1,)), ('two views over 15 degrees', (1, 2)),
        ('two views over 30 degrees', (0, 2)), ('three views over 30 degrees', (0, 1, 2))]
    assert [each.pictures for each in view_sets(CameraPlan(arc=(1, 0.0)))] == [(0,)]
    assert [each.pictures for each in view_sets(None)] == [(0,)]
    names = [each.name for each in view_sets(CameraPlan(grid=(3, 3, 0.1)))]
    assert names == ['one view', 'two views over 50 mm', 'two views over 141 mm',
                     'three views over 141 mm', 'nine views over 141 mm']
    # Every second row is from right to left: the last of four is below the first.
    assert [each.name for each in view_sets(CameraPlan(grid=(2, 2, 0.1)))] == [
        'one view', 'two views over 100 mm', 'three views over 141 mm', 'four views over 141 mm']


def test_cells_of_few_scenes_are_empty() -> None:
    assert share_text(good_enough([trial(k) for k in range(9)], Aim())) == ''
    some = [trial(k, 1 if k < 18 else 9, told_mm=2) for k in range(20)]
    assert share_text(good_enough(some, Aim())) == '90 % (18 of 20; 70 to 97 %)'
    assert findings.row(some, Aim())[4:8] == ['1.0', '0.5, 0.5', '1.0', '2.0']
    assert findings.row(some[:9], Aim()) == [''] * len(findings.HEAD)
    # Medians are of the poses that are found: here of one in twenty scenes.
    rare = [some[0], *(trial(k, 60, 50) for k in range(1, 20))]
    assert findings.row(rare, Aim()) == [
        '5 % (1 of 20; 1 to 24 %)', '5 % (1 of 20; 1 to 24 %)', '0 % (0 of 20; 0 to 16 %)',
        '95 % (19 of 20; 76 to 99 %)', '', '', '', '', '']


def test_lost_and_upside_down_are_not_good_enough() -> None:
    aim = Aim(3, 5)
    assert aim.reached(trial(0))
    assert not aim.reached(trial(0, lost=True))
    assert not aim.reached(trial(0, degrees=180))
    assert not aim.reached(trial(0, mm=3.1))


def test_causes_tell_look_alikes_from_faint_contours() -> None:
    some = [trial(0, 2, 178, gap=3.0, flipped=True, symmetric=True),
            trial(1, 2, 179, gap=-5.0, flipped=True, symmetric=True),
            trial(2, 1, 1, lost=True),
            trial(3, 80, 120, gap=30.0, flipped=True, symmetric=True),
            trial(4, 80, 60, gap=-30.0), trial(5), trial(6, 8), trial(7, 9), trial(8, 9)]
    assert causes(some, Aim()) == [
        'found, but not exactly enough (3)',
        'upright and upside down look alike within 5 nat (2)',
        'the pose is right, but its contours are too faint to be sure (1)',
        'something else looks more like the object (1)', 'the search missed the true pose (1)']


def test_the_fewest_views_that_are_good_enough_are_recommended() -> None:
    good = [trial(k) for k in range(20)]
    poor = [trial(k, 2, 179, gap=2.0, flipped=True, symmetric=True) if k < 6 else trial(k)
            for k in range(20)]
    said = recommendation([ONE, THREE], {ONE.name: poor, THREE.name: good}, Aim())
    assert said.startswith('Three views over 30 degrees: 100 % (20 of 20; 84 to 100 %) within '
                           '3 mm and 5 degrees.')
    assert ('One view is not enough: 70 % (14 of 20; 48 to 85 %); upright and upside down look '
            'alike within 2 nat (6).') in said
    assert recommendation([ONE, THREE], {ONE.name: good, THREE.name: good},
                          Aim()).startswith('One view: 100 %')
    none = recommendation([ONE, THREE], {ONE.name: poor, THREE.name: poor}, Aim())
    assert none.startswith('Not yet: the best is one view, 70 %')
    assert 'Too few' in recommendation([ONE], {ONE.name: good[:3]}, Aim())


def test_wrong_poses_are_the_worst_then_lost_ones() -> None:
    some = [trial(0, 5), trial(1, 90, lost=True), trial(2, 60, 50), trial(3, 1)]
    assert [each.seed for each in worst(some, 3)] == [2, 1, 0]


def test_groups_are_exhaustive_and_rare_surroundings_are_one() -> None:
    some = [trial(k, capture=('table', 'sink', 'shelf')[0 if k < 12 else 1 + k % 2] + ': glass',
                  distance=0.3 + 0.01 * k) for k in range(20)]
    for groups in (findings.surroundings(some), findings.distances(some)):
        belongs = [[of(each) for _, of in groups] for each in some]
        assert (np.sum(belongs, axis=1) == 1).all()
    assert [name for name, _ in findings.surroundings(some)] == ['table', 'others']


def test_sets_of_the_same_name_are_one() -> None:
    names = [each.name for each in view_sets(CameraPlan(arc=(3, 0.0)))]
    assert len(names) == len(set(names))


def test_twenty_scenes_have_two_ranges_of_distance_and_equal_ones_have_one() -> None:
    some = [trial(k, distance=0.3 + 0.01 * k) for k in range(20)]
    groups = findings.distances(some)
    assert [sum(map(of, some)) for _, of in groups] == [10, 10]
    assert len(findings.distances([trial(k) for k in range(30)])) == 1


def test_of_equally_few_views_the_better_are_recommended() -> None:
    near, far = ViewSet('two views over 15 degrees', (0, 1)), ViewSet('two over 30', (0, 2))
    trials = {near.name: [trial(k, 1 if k < 18 else 9) for k in range(20)],
              far.name: [trial(k) for k in range(20)]}
    assert recommendation([near, far], trials, Aim()).startswith('Two over 30')


def test_the_curve_is_the_share_told_within_each_error() -> None:
    some = [trial(0, 1), trial(1, 2), trial(2, 3, lost=True), trial(3, 1, 90)]
    np.testing.assert_array_equal(success(some, np.array([0.5, 1.5, 50]), Aim()), [0, 25, 50])


@pytest.mark.parametrize('count', [1, 10])
def test_rows_have_a_cell_for_each_column(count: int) -> None:
    assert len(findings.row([trial(k) for k in range(count)], Aim())) == len(findings.HEAD)


def test_tables_of_groups_have_the_columns_of_all(tmp_path: Path) -> None:
    some = [trial(k, 1 if k < 12 else 60, distance=0.3 + 0.01 * k, told_mm=2) for k in range(20)]
    study = Feasibility(MODEL, {}, (ONE,), {ONE.name: some}, Aim(), tmp_path)
    (head, rows), (by_head, by_rows) = study.table(), study.table_by(
        'distance', findings.distances(some))
    assert by_head == ['views', 'distance', *head[1:]]
    assert [row[:2] for row in by_rows] == [[ONE.name, '0.30 to 0.40 m'],
                                            [ONE.name, '0.40 to 0.49 m']]
    assert by_rows[0][2:] == findings.row(some[:10], Aim())
    assert by_rows[1][2:7] == ['20 % (2 of 10; 6 to 51 %)', '20 % (2 of 10; 6 to 51 %)',
                               '0 % (0 of 10; 0 to 28 %)', '80 % (8 of 10; 49 to 94 %)', '']
    assert study.table_by('distance', [('all', lambda _: True)])[1][0][2:] == rows[0][1:]
