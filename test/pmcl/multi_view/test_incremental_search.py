"""Views that come one after the other: as good as a search of the whole region, for less."""

import logging
from copy import copy
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pmcl_scenes import CAMERA
from test_multi_view import (
    BRACKET,
    CUP,
    around,
    error,
    found,
    maps_seen,
    settings,
    truth_of,
    two_exchanged,
)

from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.pmcl.modes import ambiguous_poses
from pmcl_ros.pmcl.multi_view.incremental_search import IncrementalSearch
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer

ANGLES = [0, 25, -25, 12]


@pytest.fixture(scope='module')
def evidence(_session_context):
    _session_context.use()
    return maps_seen(_session_context, CUP, truth_of(CUP), around(ANGLES))


@pytest.fixture(scope='module')
def localizer():
    with MultiViewLocalizer(CUP, settings()) as localizer:
        yield localizer


@pytest.fixture(scope='module')
def begun(localizer, evidence):
    """A search that has seen the first view."""
    search = IncrementalSearch(localizer)
    assert not search.localize(first(evidence, 1), np.random.default_rng(0)).lost
    return search


@pytest.fixture
def search(begun):
    """It goes on, and leaves what has begun as it is."""
    return copy(begun)


def first(evidence, count):
    """The first views, as values of their own, as those of another message are."""
    return replace(evidence, views=tuple(replace(each) for each in evidence.views[:count]))


def test_each_view_makes_the_pose_surer_for_less_than_a_search(evidence, localizer, caplog):
    caplog.set_level(logging.INFO)
    search, sigmas, bounds = IncrementalSearch(localizer), [], []
    for count in range(1, len(ANGLES) + 1):
        estimate = search.localize(first(evidence, count), np.random.default_rng(count))
        assert not estimate.lost
        assert estimate.hidden == ()
        if count > 1:
            assert error(CUP, estimate.pose, truth_of(CUP))[0] < 1
            assert caplog.messages.count('searched with views added (1) from the last pose') == (
                count - 1)
        sigmas.append(np.sqrt(np.trace(estimate.covariance[:3, :3])))
        bounds.append(np.trace(localizer.bound(first(evidence, count), truth_of(CUP))[:3, :3]))
    whole = found(CUP, evidence)
    assert CUP.symmetry.credible_level(whole.pose, estimate.pose, whole.covariance) < 0.9
    assert estimate.evaluations < 0.5 * whole.evaluations
    assert all(after < before for before, after in pairwise(bounds))
    # The model error follows how far the views disagree, which some views tell roughly.
    assert all(after < 1.3 * before for before, after in pairwise(sigmas))
    assert sigmas[-1] < 0.8 * sigmas[1]
    assert sigmas[1] < 0.4 * sigmas[0]
    assert sigmas[-1] < 0.2 * sigmas[0]


def moved(evidence):
    """The same pictures, where the first camera is told to be elsewhere."""
    camera = evidence.views[0].camera_to_reference.copy()
    camera[0, 3] += 0.001
    return replace(evidence, views=(replace(evidence.views[0], camera_to_reference=camera),
                                    *evidence.views[1:]))


@pytest.mark.parametrize('given', [
    lambda evidence: first(evidence, 1), lambda evidence: moved(first(evidence, 2)),
    lambda evidence: replace(evidence, views=evidence.views[1:3])],
    ids=['the same', 'from elsewhere', 'others'])
def test_what_is_not_the_last_views_and_more_is_searched_as_the_first(evidence, search, given):
    estimate = search.localize(given(evidence), np.random.default_rng(0))
    np.testing.assert_array_equal(estimate.pose, found(CUP, given(evidence)).pose)


def test_after_a_reset_views_are_searched_as_the_first(evidence, search):
    search.reset()
    estimate = search.localize(first(evidence, 2), np.random.default_rng(0))
    np.testing.assert_array_equal(estimate.pose, found(CUP, first(evidence, 2)).pose)


def test_a_pose_that_more_views_contradict_is_given_up(context, evidence, search, caplog):
    """What the first view showed was something else, or has moved."""
    caplog.set_level(logging.INFO)
    elsewhere = truth_of(CUP)
    elsewhere[:3, 3] += [0.03, -0.03, 0.02]
    moved = maps_seen(context, CUP, elsewhere, around(ANGLES[1:3]))
    given = replace(moved, views=(evidence.views[0], *moved.views))
    estimate = search.localize(given, np.random.default_rng(0))
    assert not estimate.lost
    assert estimate.hidden == (0,)
    assert error(CUP, estimate.pose, elsewhere)[0] < 1
    assert ('searched with views added (2) from the last pose, where it is not: searching the '
            'region of interest') in caplog.messages


def test_views_that_were_exchanged_are_told_where_they_come_one_by_one(context, localizer, caplog):
    """Near the pose by the first alone the rays of both meet, at a wrong place."""
    evidence, truth, _ = two_exchanged(context)
    blind = replace(evidence, views=tuple(replace(each, view=None) for each in evidence.views))
    searches = []
    for each in (blind, evidence):
        search, rng = IncrementalSearch(localizer), np.random.default_rng(0)
        assert not search.localize(first(each, 1), rng).lost
        caplog.clear()
        searches.append(search.localize(first(each, 2), rng))
    claimed, estimate = searches
    assert not claimed.lost
    assert error(CUP, claimed.pose, truth)[0] > 5
    assert estimate.lost
    line, = caplog.messages
    assert 'those of views 0 and 1 are exchanged' in line


@pytest.mark.parametrize(('model', 'hopeless'), [(CUP, False), (BRACKET, True)],
                         ids=['cup', 'bracket'])
def test_near_a_pose_what_it_could_be_mistaken_for_is_tried_too(context, model, hopeless):
    """A pose by less evidence may have been turned, or tilted the other way. Where that is far
    behind the pose, all views need not judge it."""
    truth = truth_of(model)
    evidence = maps_seen(context, model, truth, around(ANGLES), CAMERA)
    starts = ambiguous_poses(model, truth)
    assert len(starts) >= 3
    with MultiViewLocalizer(model, settings()) as localizer:
        for start in (truth, *starts):
            seen = []
            estimate = localizer.localize_near(evidence, np.random.default_rng(0), start[None],
                                               watch=seen.append)
            off = pose_error(estimate.pose, truth, model.symmetry)
            assert off.translation < 0.0005
            assert off.rotation < np.deg2rad(1)
            if start is truth:
                judged = any(each.stage == 'ambiguous' for each in seen)
                assert judged != hopeless
