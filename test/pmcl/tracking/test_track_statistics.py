"""What is usual of made-up looks."""

import numpy as np
import pytest

from pmcl_ros.geometry.header import Header
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.tracking.track_statistics import TrackStatistics


def seen(support, evidence):
    return PoseEstimate(Header(1), np.eye(4), np.eye(6), np.eye(4)[None], np.zeros(1), 1.0, False,
                        'followed', support=support, evidence=evidence)


def looks(count, rng):
    usual = TrackStatistics()
    values = rng.normal([0.5, 2.0], [0.4, 0.1], (count, 2))
    for support, evidence in values:
        usual.remember(seen(support, evidence))
    return usual, values[-30:].mean(axis=0), values[-30:].std(axis=0)


@pytest.mark.parametrize('count', [10, 30, 50])
def test_three_standard_deviations_below_the_mean_of_the_last_thirty_are_unusual(count):
    usual, mean, scatter = looks(count, np.random.default_rng(count))
    assert usual.known
    for least in (0.2, 0.5):
        limit = mean - 3 * np.maximum(scatter, least)
        for off, held in ((1e-6, True), (-1e-6, False)):
            np.testing.assert_array_equal(usual.held(seen(limit[0] + off, 9), least), [held, True])
            np.testing.assert_array_equal(usual.held(seen(9, limit[1] + off), least), [True, held])


def test_of_what_was_seldom_seen_or_forgotten_nothing_is_unusual():
    usual, *_ = looks(9, np.random.default_rng(0))
    forgotten, *_ = looks(30, np.random.default_rng(0))
    forgotten.forget()
    for each in (usual, forgotten):
        assert not each.known
        assert each.held(seen(-9, -9), 0.2).all()


def test_old_looks_are_forgotten_one_by_one_while_it_is_not_seen():
    usual, *_ = looks(30, np.random.default_rng(3))
    usual.remember(seen(0.5, 9.0))  # the last of them
    for known in [True] * 20 + [False] * 15:
        usual.fade()
        assert usual.known == known
        assert not known or not usual.half_there(seen(0.5, 0.9))
    assert usual.half_there(seen(0.5, 0.9))  # who knows


def test_what_is_well_among_what_was_seen_is_typical():
    usual, mean, scatter = looks(30, np.random.default_rng(4))
    scatter = np.maximum(scatter, 0.2)
    for off, typical in (([0, 0], True), ([-9, -9], True), ([1.4, -9], True), ([-9, 1.43], False),
                         ([0.99, 0.99], True), ([1.01, 1.01], False)):
        assert usual.typical(seen(*(mean - off * scatter))) == typical
    few, *_ = looks(9, np.random.default_rng(4))
    assert not few.typical(seen(*mean))


def test_half_of_the_usual_evidence_is_asked():
    usual, mean, _ = looks(30, np.random.default_rng(5))
    for evidence, there in ((mean[1] / 2 + 1e-6, True), (mean[1] / 2 - 1e-6, False)):
        assert usual.half_there(seen(-9, evidence)) == there
