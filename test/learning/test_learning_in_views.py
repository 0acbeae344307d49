"""What is learned from searches in several views, from deviations whose origin is known."""

import numpy as np
import pytest

from pmcl_ros.learning.posed_views import (
    ViewsDeviation,
    ViewsSearch,
    fitted_shares,
    learned_from,
)
from pmcl_ros.runtime.errors import LocalizationError


def deviations(count, agreeing, disagreeing, seed=0):
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        root = rng.normal(size=(5, 5))
        error, noise = root @ root.T, 0.05 * np.eye(5)
        apart = float(rng.uniform(0, 2))
        spread = noise + (agreeing + disagreeing * apart) * error
        made.append(ViewsDeviation(rng.multivariate_normal(np.zeros(5), spread), noise, error,
                                   apart))
    return made


@pytest.mark.parametrize('shares', [(0.1, 1.0), (0.5, 0.2)])
def test_the_shares_that_made_the_deviations_are_found(shares):
    agreeing, disagreeing = fitted_shares(deviations(600, *shares))
    assert agreeing == pytest.approx(shares[0], rel=0.3)
    assert disagreeing == pytest.approx(shares[1], rel=0.3)


def test_thresholds_are_between_objects_there_and_elsewhere():
    rng = np.random.default_rng(1)
    found = [ViewsSearch(True, support, 1.7 + 0.1 * support, 1.0, each) for support, each in zip(
        rng.normal(1.2, 0.2, 200), deviations(200, 0.2, 1.0), strict=True)]
    found += [ViewsSearch(False, support, 1.0, 1.0) for support in rng.normal(-0.5, 0.3, 200)]
    lines = []
    learned = learned_from(found, 0.95, 0.05, lines.append)
    elsewhere = np.array([each.support for each in found if not each.there])
    assert (elsewhere > learned.least_support).mean() == pytest.approx(0.05, abs=0.01)
    assert learned.least_support < 0.6
    assert 1.7 < learned.least_evidence < 1.9
    assert learned.agreeing == pytest.approx(0.2, rel=0.6)
    assert any('truths in the 90 % region: 90 %' in line for line in lines)


def test_an_ambiguous_pose_elsewhere_does_not_raise_the_threshold():
    found = [ViewsSearch(True, 1.0, 1.7, 1.0, each) for each in deviations(60, 0.2, 1.0)]
    clear = found + [ViewsSearch(False, -0.5, 1.0, 1.0)] * 60
    ambiguous = found + [ViewsSearch(False, -0.5, 1.0, 1.0)] * 57 + [
        ViewsSearch(False, 2.0, 1.0, 0.6)] * 3
    one, other = (learned_from(each, 0.95, 0.05, lambda _: None) for each in (clear, ambiguous))
    assert one.least_support == other.least_support == -0.5


def test_too_few_searches_are_refused():
    with pytest.raises(LocalizationError, match='learn from more scenes'):
        learned_from([ViewsSearch(True, 1.0, 1.7, 1.0)], 0.95, 0.05, lambda _: None)
