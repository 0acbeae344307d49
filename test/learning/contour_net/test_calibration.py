"""Logits of known meaning are calibrated to it; average precision is that of its definition."""

import numpy as np
import pytest
from scipy.special import expit, logit

from pmcl_ros.learning.contour_net.calibration import Histogram


@pytest.fixture(scope='module')
def known():
    """A logit x of which the log odds are 0.7 x - 2."""
    rng = np.random.default_rng(0)
    x = rng.normal(-1, 3, 2_000_000)
    return Histogram.count(x, (rng.random(x.size) < expit(0.7 * x - 2)).astype(float)), x


def test_scale_and_bias_are_recovered(known):
    histogram, x = known
    found = histogram.calibration()
    assert found.scale == pytest.approx(0.7, abs=0.01)
    assert found.bias == pytest.approx(-2, abs=0.02)
    rate = expit(0.7 * x - 2).mean()
    assert found.rate == pytest.approx(rate, abs=0.001)
    assert found.offset == pytest.approx(found.bias - logit(found.rate), abs=1e-9)


def test_what_is_told_is_so(known):
    histogram, _ = known
    predicted, so = histogram.reliability(histogram.calibration())
    assert len(predicted) > 10
    np.testing.assert_allclose(predicted, so, atol=0.3)
    # Information of the logit: of the entropy without it, what is left with it.
    x = np.linspace(-16, 14, 30001)
    weight = np.exp(-(x + 1) ** 2 / 18)
    chance = expit(0.7 * x - 2)
    entropy = [-(p * np.log(p) + (1 - p) * np.log(1 - p)) for p in (
        (chance @ weight) / weight.sum(), chance)]
    assert histogram.nats(histogram.calibration()) == pytest.approx(
        entropy[0] - (entropy[1] @ weight) / weight.sum(), abs=0.001)


def test_average_precision():
    logits = np.array([4.0, 3, 2, 1])
    assert Histogram.count(logits, np.array([1.0, 1, 0, 0])).average_precision() == 1
    assert Histogram.count(logits, np.array([0.0, 1, 0, 1])).average_precision() == 0.5
    assert Histogram.count(np.zeros(4), np.array([0.0, 1, 0, 0])).average_precision() == 0.25


def test_parts_add_up():
    rng = np.random.default_rng(1)
    x, true = rng.normal(0, 40, 1000), rng.random(1000)  # many beyond the bins
    both = Histogram.count(x[:300], true[:300]) + Histogram.count(x[300:], true[300:])
    whole = Histogram.count(x, true)
    np.testing.assert_allclose(both.true, whole.true)
    np.testing.assert_array_equal(both.pixels, whole.pixels)
    assert whole.pixels.sum() == 1000
