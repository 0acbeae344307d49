"""The points that the sampler begins with."""

import numpy as np
import pytest
from scipy.stats import qmc

from pmcl_ros.geometry.halton import normal_points


@pytest.mark.parametrize('dimensions', range(1, 7))
@pytest.mark.parametrize('count', [1, 48, 1500])
def test_they_are_those_of_scipy_to_the_last_digit(dimensions, count):
    ours, theirs = np.random.default_rng(dimensions), np.random.default_rng(dimensions)
    engine = qmc.Halton(dimensions, seed=theirs)
    expected = qmc.MultivariateNormalQMC(np.zeros(dimensions), engine=engine).random(count)
    np.testing.assert_array_equal(normal_points(count, dimensions, ours), expected)
    assert ours.random() == theirs.random()  # nor does what is drawn next differ
    assert ours.spawn(1)[0].random() == theirs.spawn(1)[0].random()
