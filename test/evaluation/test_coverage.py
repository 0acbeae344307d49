"""Is the posterior as sure as it should be? On random volumes, started beside the truth."""

import numpy as np
from scipy.stats import binom

from pmcl_ros.evaluation.coverage import run_coverage

TRIALS = 20


def test_the_truth_is_in_the_credible_regions_as_often_as_they_say():
    found = list(run_coverage(TRIALS, whole=False))
    levels = np.array([each.level for each in found])
    # In the 90 % region in 80 to 97 % of all volumes: as many of these as that allows.
    inside = (levels <= 0.9).sum()
    assert binom.ppf(0.005, TRIALS, 0.8) <= inside <= binom.ppf(0.995, TRIALS, 0.97)
    # Neither always near the middle nor always at the edge.
    assert binom.ppf(0.005, TRIALS, 0.35) <= (levels <= 0.5).sum() <= binom.ppf(0.995, TRIALS, 0.8)
    assert np.median([each.translation for each in found]) < 0.006


def test_a_trial_is_its_seed():
    first, second = next(run_coverage(1, 4, whole=False)), next(run_coverage(1, 4, whole=False))
    assert first == second
    assert next(run_coverage(1, 5, whole=False)) != first
