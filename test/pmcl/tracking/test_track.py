"""Statistics of made-up observations, and the rules by which estimates are accepted."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.tracking.action import State
from pmcl_ros.pmcl.tracking.track import Prediction, Track, TrackStatistics


def seen(support, evidence):
    return PoseEstimate(Header(1), np.eye(4), np.eye(6), np.eye(4)[None], np.zeros(1), 1.0, False,
                        'followed', support=support, evidence=evidence)


def observations(count, rng):
    statistics = TrackStatistics()
    values = rng.normal([0.5, 2.0], [0.4, 0.1], (count, 2))
    for support, evidence in values:
        statistics.add(seen(support, evidence))
    return statistics, values[-30:].mean(axis=0), values[-30:].std(axis=0)


@pytest.mark.parametrize('count', [10, 30, 50])
def test_three_standard_deviations_below_the_mean_of_the_last_thirty_are_unusual(count):
    statistics, mean, scatter = observations(count, np.random.default_rng(count))
    assert statistics.known
    for least in (0.2, 0.5):
        limit = mean - 3 * np.maximum(scatter, least)
        for off, held in ((1e-6, True), (-1e-6, False)):
            support, evidence = (statistics.within_three_sigma(each, least) for each in (
                seen(limit[0] + off, 9), seen(9, limit[1] + off)))
            np.testing.assert_array_equal(support, [held, True])
            np.testing.assert_array_equal(evidence, [True, held])


def test_without_enough_observations_nothing_is_unlikely():
    statistics, *_ = observations(9, np.random.default_rng(0))
    forgotten, *_ = observations(30, np.random.default_rng(0))
    forgotten.clear()
    for each in (statistics, forgotten):
        assert not each.known
        assert each.within_three_sigma(seen(-9, -9), 0.2).all()


def test_old_observations_are_forgotten_one_by_one():
    statistics, *_ = observations(30, np.random.default_rng(3))
    statistics.add(seen(0.5, 9.0))  # the last of them
    for known in [True] * 20 + [False] * 15:
        statistics.forget_oldest()
        assert statistics.known == known
        assert not known or not statistics.has_half_evidence(seen(0.5, 0.9))
    assert statistics.has_half_evidence(seen(0.5, 0.9))  # who knows


def test_scores_about_the_mean_or_above_are_typical():
    statistics, mean, scatter = observations(30, np.random.default_rng(4))
    scatter = np.maximum(scatter, 0.2)
    for off, typical in (([0, 0], True), ([-9, -9], True), ([1.4, -9], True), ([-9, 1.43], False),
                         ([0.99, 0.99], True), ([1.01, 1.01], False)):
        assert statistics.is_typical(seen(*(mean - off * scatter))) == typical
    few, *_ = observations(9, np.random.default_rng(4))
    assert not few.is_typical(seen(*mean))


def test_half_of_the_mean_evidence_is_enough():
    statistics, mean, _ = observations(30, np.random.default_rng(5))
    for evidence, there in ((mean[1] / 2 + 1e-6, True), (mean[1] / 2 - 1e-6, False)):
        assert statistics.has_half_evidence(seen(-9, evidence)) == there


def test_what_faded_below_zero_evidence_is_found_anew_by_evidence_that_speaks_for_it():
    statistics = TrackStatistics()
    for _ in range(10):
        statistics.add(seen(0.5, -1.0))
    for evidence, there in ((1e-6, True), (-1e-6, False)):
        assert statistics.has_half_evidence(seen(0.5, evidence)) == there


def test_scores_of_no_contour_are_not_remembered():
    statistics, mean, scatter = observations(30, np.random.default_rng(6))
    for support, evidence in ((-np.inf, 2), (0.5, -np.inf), (np.nan, np.nan)):
        statistics.add(seen(support, evidence))
    limit = mean - 3 * np.maximum(scatter, 0.2)
    for off, held in ((1e-6, True), (-1e-6, False)):
        assert statistics.within_three_sigma(seen(*(limit + off)), 0.2).tolist() == [held, held]


SUPPORT, EVIDENCE = 1.0, 2.0  # nat / px, of all observations


def at(x, **values):
    """A followed estimate that passes the single-frame test, `x` m aside."""
    pose = np.eye(4)
    pose[0, 3] = x
    return replace(seen(SUPPORT, EVIDENCE), pose=pose, **values)


def partly(x=0.0, **values):
    return at(x, lost=True, incomplete=True, **values)


def prediction(x=0.0):
    poses = retract(np.eye(4), np.random.default_rng(0).normal(size=(500, 6)) * 0.01)
    poses[:, 0, 3] += x
    return Prediction.from_state(State.at_rest(0, poses, None), Symmetry())


def track_of(observations, **values):
    """A track with so many equal observations."""
    track = Track(Symmetry(), observed=True, **values)
    for _ in range(observations):
        track.statistics.add(at(0))
    return track


def test_a_prediction_is_as_wide_as_its_particles_whichever_of_them_is_the_first():
    poses = retract(np.eye(4), np.random.default_rng(1).normal(size=(4000, 6)) * 0.01)
    poses[0] = retract(np.eye(4), np.full((1, 6), 0.05))[0]
    made = Prediction.from_state(State.at_rest(0, poses, None), Symmetry())
    np.testing.assert_allclose(made.mean, np.eye(4), atol=1e-3)
    np.testing.assert_allclose(made.covariance, 1e-4 * np.eye(6), atol=1e-5)


def test_an_estimate_that_is_lost_in_its_own_capture_passes_no_gate():
    """Absent, or one of several places: only a missing part may be made up for."""
    for track in (track_of(12, since_search=1, confirmations=1), track_of(0),
                  replace(track_of(12), observed=False)):
        for mode in ('followed', 'default'):
            for expected in (prediction(), None):
                assert track.passes_gate(at(0, mode=mode), expected)
                assert not track.passes_gate(at(0, mode=mode, lost=True), expected)


def test_a_detection_must_look_as_usual_where_the_object_is_expected_and_half_as_well_elsewhere():
    faint = at(0, mode='default', support=SUPPORT - 1.8)
    track = track_of(12)
    assert not track.passes_gate(faint, prediction())
    for other in (replace(track, observed=False).passes_gate(faint, prediction()),
                  track.passes_gate(faint, prediction(0.06)), track.passes_gate(faint, None)):
        assert other
    assert not track.passes_gate(replace(faint, evidence=0.4 * EVIDENCE), prediction(0.06))


def test_a_part_is_found_anew_where_it_looks_as_usual_and_nothing_is_followed():
    part = partly(mode='default')
    for track, expected, found in (
            (track_of(12), None, True), (track_of(12), prediction(), False),
            (replace(track_of(12), observed=False), prediction(), True),
            (track_of(9), None, False)):
        assert track.passes_gate(part, expected) == found


@pytest.mark.parametrize('name', ['support', 'evidence'])
def test_a_complete_contour_may_be_three_sigma_below_its_history(name):
    for observations in (9, 10):
        track = track_of(observations)
        for less, accepted in ((1.8, observations < 10), (1.2, True)):  # sigma is 0.5 at least
            value = getattr(at(0), name) - less
            assert track.passes_gate(replace(at(0), **{name: value}), prediction()) == accepted


def test_an_incomplete_contour_is_accepted_for_a_while_where_it_is_followed():
    track = track_of(12, since_search=30, confirmations=1)
    assert track.passes_gate(partly(), prediction())
    for unlike in (partly(mode='default'), partly(evidence=EVIDENCE - 0.7), partly(0.06),
                   partly(in_view=0.4)):
        assert not track.passes_gate(unlike, prediction())
    for change in ({'since_search': 31}, {'confirmations': 0}, {'observed': False}):
        assert not replace(track, **change).passes_gate(partly(), prediction())


def test_of_two_incomplete_contours_the_likelier_is_accepted_where_it_is_predicted():
    followed, detected = partly(0.06), partly(0.0, mode='default')
    track = track_of(12, state=prediction().state)
    assert track.select(followed, detected, 20.0, prediction()) == (detected, True)
    assert track.observed
    # The followed one, which passes the gate, is not accepted instead.
    track = track_of(12, since_search=30, confirmations=1)
    assert track.passes_gate(followed, prediction(0.06))
    assert track.select(followed, detected, 20.0, prediction(0.06)) == (detected, False)


def test_a_comparison_that_speaks_against_a_pose_confirms_nothing():
    track = track_of(12, since_search=31, confirmations=1)
    followed, elsewhere = at(0.0), partly(0.06, mode='default')
    assert track.select(followed, elsewhere, 50.0, prediction()) == (followed, True)
    assert not track.passes_gate(partly(), prediction())


def test_a_detection_must_be_likelier_than_the_prediction_by_the_penalty():
    for log_ratio, elsewhere in ((14.9, False), (15.1, True)):
        track = track_of(12, state=prediction().state, since_search=5)
        followed, detected = at(0.0), at(0.06, mode='default')
        estimate, accepted = track.select(followed, detected, log_ratio, prediction())
        assert (estimate is detected, accepted) == (elsewhere, True)
        assert track.since_search == 0
        # A track that followed something else is dropped.
        assert (track.observed, track.state is None, track.confirmations) == (
            (False, True, 0) if elsewhere else (True, False, 1))


def test_a_lost_object_is_where_it_is_likelier_and_an_agreeing_detection_confirms_at_any_ratio():
    elsewhere, same = at(0.06, mode='default'), at(0.001, mode='default')
    for log_ratio in (-1.0, 1.0):
        lost = replace(track_of(12, state=prediction().state), observed=False)
        estimate, accepted = lost.select(at(0.0), elsewhere, log_ratio, prediction())
        assert (estimate is elsewhere, accepted) == (log_ratio > 0, True)
    track, followed = track_of(12, state=prediction().state), at(0.0)
    assert track.select(followed, same, 20.0, prediction()) == (followed, True)
    assert (track.observed, track.confirmations) == (True, 1)


def test_a_pose_is_predicted_in_the_ellipsoid_that_holds_it_in_99_of_100_captures():
    edge = 0.01 * stats.chi2.ppf(0.99, 6) ** 0.5
    for x, inside in ((0.9 * edge, True), (1.1 * edge, False)):
        assert track_of(0).in_validation_gate(at(x), prediction()) == inside
    assert not track_of(0).in_validation_gate(at(0), None)


def test_evidence_of_nothing_is_never_usual():
    track = track_of(0)
    for _ in range(10):
        track.statistics.add(at(0, evidence=0.1))
    assert track.has_usual_evidence(at(0, evidence=0.01))
    assert not track.has_usual_evidence(at(0, evidence=-0.01))


def test_before_the_statistics_are_known_both_searches_must_agree():
    track = track_of(3)
    assert not track.statistics.known
    assert track.matches_history(partly(), prediction(), agree=True)
    assert not track.matches_history(partly(), prediction(), agree=False)
    assert not track.matches_history(replace(partly(), incomplete=False), prediction(), agree=True)
    assert not replace(track, observed=False).matches_history(partly(), prediction(), agree=True)
    for in_view, matches in ((0.5, True), (0.49, False)):
        for each in (track, track_of(12)):
            assert each.matches_history(partly(in_view=in_view), prediction(), True) == matches
