"""Is the posterior as sure as it should be? On random volumes."""

import numpy as np
import pytest

from pmcl_ros.evaluation.studies.coverage import run_coverage

TRIALS = 15  # half as sure, or twice, would be outside of the bounds below


@pytest.fixture(scope='module')
def found():
    """Started beside the truth, for time's sake: the posterior alone."""
    return list(run_coverage(TRIALS, whole=False))


def test_the_truth_is_in_the_credible_regions_as_often_as_they_say(found):
    levels = np.array([each.credible_level for each in found])
    assert 0.8 * TRIALS <= (levels <= 0.9).sum() <= 0.97 * TRIALS
    # Neither always near the middle nor always at the edge.
    assert 0.35 * TRIALS <= (levels <= 0.5).sum() <= 0.8 * TRIALS
    assert np.median([each.translation_mm for each in found]) < 6
    assert np.mean([each.lost for each in found]) < 0.25


def test_the_whole_search_finds_what_is_there_and_is_not_too_sure_of_it():
    found = [each for each in run_coverage(4, 20) if not each.lost]
    assert len(found) >= 3
    for each in found:
        assert each.near
    assert np.median([each.credible_level for each in found]) < 0.97


def test_a_trial_is_its_seed(found):
    seed = 4
    assert next(run_coverage(1, seed, whole=False)) == found[seed] != found[seed + 1]
