"""What trials say together, against counts by hand and distributions that are known."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.evaluation import recall
from pmcl_ros.evaluation.result_charts import pictures
from pmcl_ros.evaluation.results import markdown, misses_table, rates_table
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.evaluation.variants import Variant
from pmcl_ros.geometry.symmetry import Symmetry

NUMBERS = {each.name: 1.0 if each.type is float else 0 for each in fields(Trial)}
BASE = NUMBERS | {'capture': 'a', 'mode': 'default', 'sought': 'a', 'film': False, 'empty': False,
                  'wrong': False, 'flipped': False, 'symmetric': True, 'inside_90': True,
                  'lost': False, 'diameter_mm': 100.0, 'width_px': 320, 'renderer': '',
                  'pose': (0.0,) * 12}

_SAMPLES = 700


def trial(mm=1.0, degrees=1.0, **other):
    return Trial(**BASE | {'translation_mm': mm, 'axis_deg': degrees, 'flipped': degrees > 90,
                           'dot': float(np.cos(np.deg2rad(degrees)))} | other)


EMPTY = trial(np.nan, np.nan, empty=True, lost=True, capture='e')
WRONG = trial(np.nan, np.nan, wrong=True, lost=False)


def test_within_counts_both_bounds_and_lost_ones_as_not_found():
    trials = [trial(4, 4), trial(4, 6), trial(8, 4), trial(15, 9), trial(4, 4, lost=True),
              trial(4, 178), EMPTY, WRONG]
    assert [recall.within(trials, *bound) for bound in recall.BOUNDS] == [4 / 6, 3 / 6, 1 / 6]
    assert np.isnan(recall.within([EMPTY], 10, 10))


def test_rates_count_what_is_claimed_and_what_is_right():
    trials = [trial(4, 4, credible_level=0.7), trial(8, 4, credible_level=0.3),
              trial(15, 9, credible_level=0.95), trial(4, 4, lost=True), trial(60, 4, lost=True),
              trial(4, 178, credible_level=1.0), EMPTY, WRONG]
    other = [replace(each, mode='edges') for each in trials if each.present]
    rates = {name: cells for name, *cells in (
        each.strip('| ').split(' | ') for each in rates_table([*trials, *other]).splitlines()[2:])}
    assert {name: [each[:each.index(';')] for each in cells] for name, cells in rates.items()
            if 'lost' not in name} == {
        'claimed, within 2 cm, 10°': 2 * ['50 % (3 of 6'],
        'within 2 cm, 10°': 2 * ['67 % (4 of 6'],
        'claimed, within 1 cm, 10°': 2 * ['33 % (2 of 6'],
        'within 1 cm, 10°': 2 * ['50 % (3 of 6'],
        'claimed, within 0.5 cm, 5°': 2 * ['17 % (1 of 6'],
        'within 0.5 cm, 5°': 2 * ['33 % (2 of 6'],
        'claimed, not right': 2 * ['17 % (1 of 6'],
        'claimed, truth in the 90 % region': 2 * ['50 % (2 of 4'],
        'claimed, truth in the 50 % region': 2 * ['25 % (1 of 4']}
    assert rates['within 2 cm, 10°'][0] == recall.share_with_interval(4 * [True] + 2 * [False])
    # Of what a row has no trials, nothing is said.
    assert rates['lost, nothing there'][0].startswith('100 % (1 of 1;')
    assert rates['lost, another object'][0].startswith('0 % (0 of 1;')
    assert len(rates['lost, nothing there']) == 1
    assert 'nan' not in rates_table([EMPTY, *other])
    assert rates_table([*trials, *other]) in markdown([*trials, *other])


def test_the_interval_of_a_share_is_wilsons():
    low, high = recall.interval([True] * 8 + [False] * 2)
    for bound in (low, high):  # the shares from which 8 of 10 is 1.96 standard deviations off
        off = abs(0.8 - bound) / np.sqrt(bound * (1 - bound) / 10)
        assert off == pytest.approx(1.96, abs=1e-3)
    assert recall.interval([True] * 5)[1] == 1
    assert np.isnan(recall.interval([])).all()


def test_success_forgives_flips_only_where_asked_and_where_there_is_an_axis():
    trials = [trial(5, 0), trial(5, 60), trial(5, 175), trial(5, 175, symmetric=False),
              trial(15, 0), trial(5, 0, lost=True)]
    bounds = [1, 0.9, 0.4, 0, -1]
    np.testing.assert_allclose(recall.success(trials, 10, bounds, False) * 6, [1, 1, 2, 2, 4])
    np.testing.assert_allclose(recall.success(trials, 10, bounds, True) * 6, [1, 2, 3, 3, 4])
    assert (recall.success(trials, 20, bounds, True) >= recall.success(trials, 10, bounds, True)
            ).all()


def test_average_recalls_are_bops():
    # 0.22 of the diameter: within 0.25, 0.30 ... 0.50; 13 px of 320 are 26 of 640: 30 ... 50.
    assert recall.average_recall([trial(mssd_mm=22.0, mspd_px=13.0)]) == (0.6, 0.5)
    assert recall.average_recall([trial(mssd_mm=22.0, mspd_px=13.0, lost=True)]) == (0, 0)
    assert recall.add_s_recall([trial(add_s_mm=9.9), trial(add_s_mm=10.1)]) == 0.5


@pytest.mark.parametrize('axis', [None, np.array([0, 0.6, 0.8])])
@pytest.mark.parametrize(('scale', 'low', 'high'), [(1, 0.87, 0.93), (3, 0.0, 0.5)])
def test_coverage_of_samples_of_a_known_gaussian(axis, scale, low, high):
    """Truths drawn from the estimate's own distribution lie in it as often as it says."""
    rng = np.random.default_rng(5)
    spread = rng.standard_normal((6, 6)) * np.repeat([0.002, 0.02], 3)[:, None]
    covariance = spread @ spread.T
    mean = np.eye(4)
    mean[:3, :3], mean[:3, 3] = Rotation.random(None, rng).as_matrix(), (0.1, 0, 0.5)
    spindle = None if axis is None else mean[:3, :3] @ axis
    levels = []
    for _ in range(_SAMPLES):
        shift = scale * spread @ rng.standard_normal(6)
        if spindle is not None:  # a turn about the axis would be forgotten, not only its size
            shift[3:] -= spindle * (spindle @ shift[3:])
        truth = mean.copy()
        truth[:3, 3] += shift[:3]
        truth[:3, :3] = Rotation.from_rotvec(shift[3:]).as_matrix() @ mean[:3, :3]
        if axis is not None:
            truth[:3, :3] = truth[:3, :3] @ Rotation.from_rotvec(rng.uniform(0, 6) * axis
                                                                  ).as_matrix()
        levels.append(Symmetry(axis).credible_level(truth, mean, covariance))
    trials = [trial(credible_level=each) for each in levels]
    assert low < recall.coverage(trials, 0.9) < high
    if scale == 1:
        assert 0.46 < recall.coverage(trials, 0.5) < 0.54
        assert np.abs(recall.levels(trials) - np.linspace(0, 1, _SAMPLES)).max() < 0.06


def test_lost_poses_claim_no_region():
    trials = [trial(credible_level=0.2), trial(credible_level=1, lost=True)]
    assert recall.coverage(trials, 0.9) == 1


def test_in_time_grows_with_the_time_and_ends_at_the_recall():
    trials = [trial(seconds=1.0), trial(seconds=3.0), trial(50, seconds=0.5),
              trial(seconds=9.0, lost=True)]
    np.testing.assert_allclose(recall.in_time(trials, [0.9, 1, 3, 10]), [0, 0.25, 0.5, 0.5])
    assert recall.in_time(trials, 10)[0] == recall.within(trials, 10, 10)


def test_tables_tell_each_kind_apart():
    trials = [trial(1, seed=0), trial(4, seed=1), EMPTY, WRONG,
              trial(3, 176, film=True, capture='b', ray_mm=-2.0)]
    lines = markdown(trials).splitlines()
    first = [each for each in lines if each.startswith('| a | default |')]
    assert '| a | default | 2 | 2.5 mm | 4.0 mm |' in first[0]
    assert any('(another object there)' in each and '| 0 of 1 |' in each for each in lines)
    assert any('| default | no film | 2 | 2.5 ± 1.5 mm |' in each for each in lines)
    film, = (each for each in lines if each.startswith('| default | behind a film'))
    assert '| 176.0 ± 0.0° | 4.0 ± 0.0° | -2.0 mm |' in film
    assert '(nothing there)' in markdown([EMPTY])


def test_a_miss_is_of_the_search_where_the_truth_has_more_evidence():
    trials = [trial(evidence_found=100.0, evidence_truth=110.0),  # right
              trial(50, evidence_found=100.0, evidence_truth=120.0),
              trial(50, evidence_found=100.0, evidence_truth=101.0, lost=True),
              trial(50, evidence_found=100.0, evidence_truth=20.0, lost=True)]
    assert '| default | 4 | 3 | 2 | 1 | 1 | 75 % | 25 % |' in misses_table(trials)
    assert misses_table(trials) in markdown(trials)
    # Each has a line, also where the claim alone was missed.
    right = trial(1, 2, evidence_found=100.0, evidence_truth=110.0, lost=True, seed=7)
    lines = markdown([*trials, right]).splitlines()
    heads = ['capture', 'mode', 'seed', 'reported', 'error', 'axis error', 'evidence found [nat]',
             'at the truth', 'at fault']
    first = lines.index(f'| {" | ".join(heads)} |') + 2
    assert lines[first:first + 4] == [
        '| a | default | 0 | claimed | 50.0 mm | 1.0° | 100 | 120 | search |',
        '| a | default | 0 | lost | 50.0 mm | 1.0° | 100 | 101 | search |',
        '| a | default | 0 | lost | 50.0 mm | 1.0° | 100 | 20 | evidence |',
        '| a | default | 7 | lost | 1.0 mm | 2.0° | 100 | 110 | claim |']
    assert not lines[first + 4]
    # Of a mode without evidence, nothing is said of it.
    without = [replace(each, mode='faithful', evidence_truth=np.nan) for each in trials]
    assert '| faithful | 4 | 3 |  |  | 1 |  |  |' in misses_table([*trials, *without])
    empty = [replace(each, empty=True, mode='faithful') for each in trials]
    assert 'nan' not in markdown([*trials, *empty])
    unknown = [trial(evidence_found=np.nan, evidence_truth=np.nan)]
    assert 'Misses' not in markdown(unknown)


def test_pictures_are_drawn_whatever_there_is():
    swept = [Variant('a=1', group='a'), Variant('a=2', group='a'), Variant('default')]
    trials = [trial(mode='a=1', seconds=1.), trial(mode='a=2', film=True, seconds=2.), trial(),
              EMPTY]
    drawn = pictures(trials, swept)
    assert set(drawn) == {'success', 'errors', 'coverage', 'time'}
    assert all(each.dtype == np.uint8 and each.ndim == 3 for each in drawn.values())
    # Two kinds of scene are two lines of charts; a sweep has a chart of its own.
    alone = pictures([trial()], [Variant('default')])
    assert drawn['success'].shape[0] == 2 * alone['success'].shape[0]
    assert drawn['time'].shape[1] > alone['time'].shape[1]
    assert pictures([EMPTY, WRONG], []) == {}
    assert set(pictures([trial(lost=True)], [])) == set(drawn)
