"""An object that edges lose is searched in other evidence of the capture too."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import COARSE, cup, depth_of, edges_seen, model_of, pose_of
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.second_search import evidence_of
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import VolumeError

CUP = model_of(cup(), [0, 0, 1])
DEPTHS = depth_labels(0.3, 0.5, 8)
TRUTH = pose_of(Rotation.from_euler('xyz', [1.8, 0.3, 0.0]), [-0.035, 0.0, 0.4])
DECOY = pose_of(Rotation.from_euler('xyz', [1.3, -0.4, 0.0]), [0.035, 0.0, 0.4])
# Of one proposal only, so that the stronger of two outlines is all that is looked at.
SETTINGS = PmclSettings(roi_center=(0, 0, 0.4), roi_size=(0.1, 0.04, 0.04), proposals=1,
                        particles=32, moves=1, renderer='numba')


def outline(context, pose, strength):
    return edges_seen(depth_of(context, CUP, pose, COARSE, 4), COARSE, DEPTHS, 0.2 * CUP.radius,
                      strength=strength)


@pytest.fixture
def truth_alone(context):
    """What other evidence sees: the object, and nothing else."""
    return outline(context, TRUTH, 2.0)


@pytest.fixture
def edges(context, truth_alone):
    """The object, and beside it a stronger outline of the same kind, the lower half of which is
    missing."""
    decoy = outline(context, DECOY, 6.0).tensor
    decoy[COARSE.height // 2:] = 0
    return replace(truth_alone, tensor=truth_alone.tensor + decoy
                   + np.array([0.05, 0.05, 0], np.float32))


class Asked:
    """Gives evidence, and counts how often it is asked for."""

    def __init__(self, evidence):
        self.evidence, self.times = evidence, 0

    def __call__(self):
        self.times += 1
        return self.evidence


def localized(edges, settings=SETTINGS, **options):
    with Localizer(CUP, settings) as localizer:
        return localizer.localize(edges, np.random.default_rng(0), **options)


def test_it_is_found_by_the_other_evidence(edges, truth_alone, caplog):
    alone, other = localized(edges), Asked(truth_alone)
    assert alone.lost
    assert np.linalg.norm(alone.pose[:3, 3] - DECOY[:3, 3]) < 0.02
    with caplog.at_level(logging.INFO):
        found = localized(replace(edges, other=other))
    assert not found.lost
    error = pose_error(found.pose, TRUTH, CUP.symmetry)
    assert error.translation < 0.01  # pixels are large here
    assert error.rotation < np.deg2rad(5)
    assert found.evaluations > alone.evaluations
    assert other.times == 1
    assert 'capture 7: edges lose the object; the edge volume finds it' in caplog.text
    assert found.as_dict()['evidence_of'] == found.evidence_of == 'edge volume'
    alike = localized(truth_alone)  # by the other evidence's own search and thresholds
    assert found.score == pytest.approx(alike.score, rel=0.05)
    assert found.least_support == alike.least_support


def test_what_edges_find_needs_no_other_evidence(edges, truth_alone):
    seen, other = replace(edges, tensor=truth_alone.tensor), Asked(truth_alone)
    found, plain = localized(replace(seen, other=other)), localized(seen)
    assert not found.lost
    assert other.times == 0
    np.testing.assert_array_equal(found.pose, plain.pose)
    np.testing.assert_array_equal(found.particles, plain.particles)


def cut(evidence, row):
    """Without the lower part of the picture."""
    tensor = evidence.tensor.copy()
    tensor[row:] = 0
    return replace(evidence, tensor=tensor)


# Rows that are left. Of much of an outline too little is left to claim it.
WHOLE, MUCH, LITTLE = COARSE.height, 102, 50
# Of edges: these lose any outline. Nothing is near the edge of the picture.
TIMID = SETTINGS.model_copy(update={'least_support': 9.0, 'roi_size': (0.1, 0.01, 0.02)})


@pytest.mark.parametrize(('of_decoy', 'of_truth'), [(WHOLE, LITTLE), (LITTLE, MUCH)])
def test_where_both_lose_it_the_pose_with_more_evidence_by_both_is_told(context, of_decoy,
                                                                        of_truth):
    """Edges see a part of the decoy, the other evidence a part of the object."""
    decoy = cut(outline(context, DECOY, 6.0), of_decoy)
    seen = cut(outline(context, TRUTH, 6.0), of_truth)
    alone, other = localized(decoy, TIMID), Asked(seen)
    again = localized(replace(decoy, other=other), TIMID)
    assert alone.lost
    assert again.lost
    assert other.times == 1
    assert again.evaluations > alone.evaluations
    if of_truth == MUCH:
        assert np.linalg.norm(again.pose[:3, 3] - TRUTH[:3, 3]) < 0.02
        assert again.evidence_of == 'edge volume'
        with Localizer(CUP, SETTINGS) as localizer:
            poses = np.stack([alone.pose, again.pose])
            both = localizer.evidence(decoy, poses) + localizer.evidence(seen, poses)
        assert both[1] > both[0] + 50
    else:
        np.testing.assert_array_equal(again.pose, alone.pose)
        assert again.evidence_of == ''
    without = localized(replace(decoy, other=Asked(None)), TIMID)
    assert without.evaluations == alone.evaluations


def test_a_search_that_is_stopped_or_told_where_to_begin_is_not_begun_again(edges, truth_alone):
    other = Asked(truth_alone)
    both = replace(edges, other=other)
    assert localized(both, progress=lambda _: False).lost
    assert localized(both, start=DECOY[None]).lost
    assert other.times == 0


def test_what_edges_hardly_show_is_claimed_only_where_the_other_evidence_shows_it_too(
        truth_alone, context, caplog):
    decoy = outline(context, DECOY, 6.0).tensor
    decoy[3 * COARSE.height // 4:] = 0  # a smaller part of it is missing
    edges = replace(truth_alone, tensor=truth_alone.tensor + decoy)
    bold = SETTINGS.model_copy(update={'least_support': -20.0})
    alone = localized(edges, bold)
    assert not alone.lost
    assert alone.support < 0
    assert np.linalg.norm(alone.pose[:3, 3] - DECOY[:3, 3]) < 0.02
    with caplog.at_level(logging.INFO):
        moved = localized(replace(edges, other=Asked(truth_alone)), bold)
    assert np.linalg.norm(moved.pose[:3, 3] - TRUTH[:3, 3]) < 0.01
    assert not moved.lost
    assert 'edges are unsure of the object; the edge volume finds it' in caplog.text
    assert moved.least_support == truth_alone.least_support  # what was chosen is for edges
    agreeing = Asked(outline(context, DECOY, 2.0))
    agreed = localized(replace(edges, other=agreeing), bold)
    np.testing.assert_array_equal(agreed.particles, alone.particles)
    assert agreed.evaluations == alone.evaluations
    assert agreeing.times == 1
    nothing = replace(truth_alone, tensor=np.zeros_like(truth_alone.tensor))
    denied = localized(replace(edges, other=Asked(nothing)), bold)
    assert denied.lost
    assert denied.evidence_of == 'edge volume'  # whose numbers tell why
    with caplog.at_level(logging.INFO):
        unknown = localized(replace(edges, other=Asked(None)), bold)
    np.testing.assert_array_equal(unknown.particles, alone.particles)
    assert 'edges are unsure of the object, and no other evidence came' in caplog.text
    parts = []

    def until_the_second(part):
        parts.append(part)
        return parts.count(1.0) < 3

    stopped = localized(replace(edges, other=Asked(truth_alone)), bold, progress=until_the_second)
    np.testing.assert_array_equal(stopped.particles, alone.particles)


@pytest.mark.parametrize('error', [VolumeError('too many pixels'), MemoryError('no more')])
def test_other_evidence_that_cannot_be_had_leaves_the_object_lost(edges, caplog, error):
    def fail():
        raise error

    alone, found = localized(edges), localized(replace(edges, other=fail))
    np.testing.assert_array_equal(found.particles, alone.particles)
    assert found.lost
    assert 'edges lose the object, and the search in other evidence failed: ' in caplog.text
    assert str(error) in caplog.text


def test_an_error_of_the_program_is_not_hidden(edges):
    def fail():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        localized(replace(edges, other=fail))


def test_generations_of_the_second_search_are_watched_where_it_counts(context, truth_alone):
    decoy = outline(context, DECOY, 6.0)
    for other, times in ((truth_alone, 2), (cut(truth_alone, LITTLE), 1)):
        both, stages = replace(decoy, other=Asked(other)), []
        watched = localized(both, TIMID, watch=lambda each, stages=stages: stages.append(
            each.stage))
        np.testing.assert_array_equal(watched.particles, localized(both, TIMID).particles)
        assert stages.count('proposals') == stages.count('modes') == times


def test_what_the_numbers_of_an_estimate_are_of(edges, truth_alone):
    both = replace(edges, other=Asked(truth_alone))
    found = localized(both)
    assert evidence_of(found, both) is truth_alone
    assert evidence_of(replace(found, evidence_of=''), both) is both
    with Localizer(CUP, SETTINGS) as localizer:
        assert localizer.evidence(truth_alone, found.pose[None])[0] == pytest.approx(found.score)


def test_later_captures_are_searched_alike_whether_other_evidence_comes_or_not(edges, truth_alone):
    found = []
    for first in (Asked(None), Asked(truth_alone)):
        rng, second = np.random.default_rng(0), Asked(truth_alone)
        with Localizer(CUP, SETTINGS) as localizer:
            localizer.localize(replace(edges, other=first), rng)
            found.append(localizer.localize(replace(edges, other=second), rng))
        assert first.times == second.times == 1
    np.testing.assert_array_equal(found[0].particles, found[1].particles)
