"""Several objects in one volume, and their names."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from multi_object_scenes import BOTTLE, CUP, SETTINGS, seen_together, standing

from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.penetration import MAX_PENETRATION, Interior, deepest_penetration
from pmcl_ros.pmcl.multi_object.scene_estimate import distinct_names
from pmcl_ros.pmcl.multi_object.scene_localizer import SceneLocalizer
from pmcl_ros.runtime.errors import LocalizationError

FRONT, BEHIND = standing(-0.012, 0.005, 0.38, 0.3), standing(0.02, 0.0, 0.46, 0.3)


def located(models, volume, seed=0, progress=None):
    with SceneLocalizer(models, SETTINGS) as localizer:
        return localizer.localize(volume, np.random.default_rng(seed), progress)


def error(estimate, truth, model):
    return pose_error(estimate.pose, truth, model.symmetry)


@pytest.fixture(scope='module')
def overlapping():
    return seen_together([(CUP, FRONT), (BOTTLE, BEHIND)])


@pytest.fixture(scope='module')
def found(overlapping):
    return located([CUP, BOTTLE], overlapping)


def test_one_behind_another_is_found_as_well_as_alone(found):
    assert found.names == ('cup', 'bottle')
    for estimate, alone, truth, model in zip(found.estimates, found.alone, (FRONT, BEHIND),
                                             (CUP, BOTTLE), strict=True):
        off = error(estimate, truth, model)
        assert not estimate.lost
        assert off.translation < max(0.006, error(alone, truth, model).translation + 0.002)
        assert off.rotation < 0.12
    assert found.depth <= MAX_PENETRATION
    assert set(found.as_dict()['objects']) == {'cup', 'bottle'}
    assert [line.split(':')[0] for line in found.describe().splitlines()] == ['cup', 'bottle']


def test_what_is_hidden_takes_nothing_from_the_support(found):
    # Its search alone took what the cup hides for a part that is missing.
    assert found.estimates[1].support > found.alone[1].support


def test_the_same_seed_gives_the_same_poses_bit_for_bit(found, overlapping):
    again = located([CUP, BOTTLE], overlapping)
    for one, other in zip(found.estimates, again.estimates, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
        np.testing.assert_array_equal(one.covariance, other.covariance)
        np.testing.assert_array_equal(one.particles, other.particles)


def test_two_alike_are_at_two_places_from_left_to_right_and_an_absent_one_is_lost(monkeypatch):
    localize, searched = Localizer.localize, []
    monkeypatch.setattr(Localizer, 'localize', lambda each, edges, *given, feasible: (
        searched.append((edges, feasible)),
        localize(each, edges, *given, feasible=feasible))[1])
    left, right = standing(-0.04, 0, 0.42, 0.2), standing(0.035, 0.01, 0.4, 0.2)
    volume = seen_together([(CUP, right), (CUP, left)])
    shares = []
    found = located([CUP, BOTTLE, CUP], volume, progress=lambda done: not shares.append(done))
    assert found.names == ('cup', 'bottle', 'cup_2')
    assert [each.lost for each in found.estimates] == [False, True, False]
    for estimate, truth in zip(found.estimates[::2], (left, right), strict=True):
        assert error(estimate, truth, CUP).translation < 0.006
    assert found.depth <= MAX_PENETRATION
    # Once more the absent one is searched for: outside of the others, in what edges they leave.
    assert [edges is volume and feasible is None for edges, feasible in searched] == [
        True, True, False]
    edges, feasible = searched[2]
    assert (edges.tensor > 0.2).sum() < 0.3 * (volume.tensor > 0.2).sum()
    np.testing.assert_array_equal(feasible(np.stack([left, right, standing(0, 0.2, 0.4)])),
                                  [False, False, True])
    # The two objects alone have 70 % of the time, each of three searches for missing ones 10 %.
    assert shares == sorted(shares)
    assert 0.5 < shares[-1] <= 0.8


def test_what_is_seen_a_little_in_something_else_is_moved_out_along_the_line_of_sight():
    # The edges are those of a bottle 3 mm deep in a cup, which cannot be.
    front, behind = standing(-0.012, 0.005, 0.4, 0.1), standing(0.008, 0.0, 0.441, 0.1)
    seen = seen_together([(CUP, front), (BOTTLE, behind)], through=True)
    found = located([CUP, BOTTLE], seen)
    interiors = Interior.from_model(CUP), Interior.from_model(BOTTLE)
    before, after = (
        deepest_penetration(list(zip(interiors, (each.pose for each in estimates), strict=True)))
        for estimates in (found.alone, found.estimates))
    assert before > MAX_PENETRATION
    assert 0 < after == found.depth <= MAX_PENETRATION
    assert not any(each.lost for each in found.estimates)
    moved = found.estimates[1].pose[:3, 3] - found.estimates[0].pose[:3, 3] - (
        found.alone[1].pose[:3, 3] - found.alone[0].pose[:3, 3])
    assert moved[2] > 0.001
    assert np.abs(moved[:2]).max() < 0.2 * moved[2]


def test_once_stopped_no_further_object_is_searched_for(overlapping, monkeypatch):
    localize, searched = Localizer.localize, []
    monkeypatch.setattr(Localizer, 'localize', lambda each, *given, **named: (
        searched.append(each), localize(each, *given, **named))[1])
    with SceneLocalizer([CUP, BOTTLE], SETTINGS) as localizer:
        found = localizer.localize(overlapping, np.random.default_rng(0), lambda _: False)
    assert len(searched) == 1
    assert len(found.alone) == 2
    assert all(each.lost for each in found.estimates)


def test_what_is_impossible_is_told(overlapping):
    with pytest.raises(LocalizationError, match='no objects'):
        SceneLocalizer([], SETTINGS)
    with pytest.raises(LocalizationError, match='at most 8'):
        SceneLocalizer([CUP] * 9, SETTINGS)
    with pytest.raises(LocalizationError, match="called 'cup'"):
        SceneLocalizer([CUP, replace(CUP)], SETTINGS)
    with pytest.raises(LocalizationError, match='faithful'):
        SceneLocalizer([CUP], SETTINGS.model_copy(update={'mode': 'faithful'}))
    with pytest.raises(LocalizationError, match='edges'):
        located([CUP], replace(overlapping, from_likelihood=True))


def test_copies_are_numbered_and_what_ros_does_not_take_is_replaced():
    assert distinct_names(['glass', 'jar', 'glass', 'glass']) == ['glass', 'jar', 'glass_2',
                                                                  'glass_3']
    assert distinct_names(['wine glass-4.a', '3m', '...']) == ['wine_glass_4_a', 'object_3m',
                                                               'object']


@pytest.mark.parametrize(('names', 'words'), [
    ([], 'no objects'), (['a b', 'a-b'], "'a_b'"), (['jar', 'jar', 'jar_2'], 'jar_2')])
def test_names_that_would_be_alike_are_refused(names, words):
    with pytest.raises(LocalizationError, match=words):
        distinct_names(names)


@given(st.lists(st.text(max_size=8), min_size=1, max_size=5))
def test_whatever_files_are_called_topics_are_possible(names):
    try:
        made = distinct_names(names)
    except LocalizationError:
        return
    assert len(set(made)) == len(names)
    for each in made:
        assert re.fullmatch(r'[A-Za-z][A-Za-z0-9_]*', each)
        assert '__' not in each
