"""Random trees between postures."""

from itertools import pairwise

import numpy as np
import pytest

from pmcl_ros.simulation.manipulation.roadmap import connect

LIMITS = np.array([[-3.0, 3.0]] * 7)
START, GOAL = np.full(7, -1.0), np.full(7, 1.0)


def between(a, b):
    return a + (b - a) * np.linspace(0, 1, 60)[:, None]


def is_free(a, b):
    """A wall at joint 0 = 0, but for an opening where joint 1 is large."""
    points = between(a, b)
    return not ((abs(points[:, 0]) < 0.1) & (points[:, 1] < 0.8)).any()


@pytest.mark.parametrize('seed', range(5))
def test_a_path_leads_around_a_wall(seed):
    assert not is_free(START, GOAL)
    corners = connect(START, GOAL, LIMITS, is_free, np.random.default_rng(seed))
    assert np.array_equal(corners[[0, -1]], np.stack([START, GOAL]))
    assert all(is_free(a, b) for a, b in pairwise(corners))
    assert ((corners >= LIMITS[:, 0]) & (corners <= LIMITS[:, 1])).all()
    assert abs(np.diff(corners, axis=0)).max(axis=1).sum() < 6  # straight: 2


def test_there_is_none_through_a_closed_wall():
    def closed(a, b):
        return bool((a[0] < 0) == (b[0] < 0))
    assert connect(START, GOAL, LIMITS, closed, np.random.default_rng(0)) is None
