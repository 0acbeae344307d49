"""The joint assignment has the largest value of all."""

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.pmcl.multi_object.candidates import (
    MOST_ASSIGNMENTS,
    best_assignment,
    most_candidates,
)
from pmcl_ros.runtime.errors import LocalizationError

VALUES = st.one_of(st.just(-np.inf), st.integers(-9, 9).map(float))


def worth(own, pairs, chosen):
    total = sum(values[k] for values, k in zip(own, chosen, strict=True) if k is not None)
    for i, j in combinations(range(len(own)), 2):
        if chosen[i] is not None and chosen[j] is not None:
            total += pairs[i, j][chosen[i], chosen[j]]
    return total


@st.composite
def problems(draw):
    sizes = draw(st.lists(st.integers(0, 3), min_size=1, max_size=4))
    own = [np.array([draw(VALUES) for _ in range(size)]) for size in sizes]
    pairs = {(i, j): np.array([draw(VALUES) for _ in range(sizes[i] * sizes[j])]
                              ).reshape(sizes[i], sizes[j])
             for i, j in combinations(range(len(sizes)), 2)}
    return own, pairs


@given(problems())
def test_no_choice_is_worth_more(problem):
    own, pairs = problem
    choices = product(*([None, *range(len(each))] for each in own))
    chosen = best_assignment(own, pairs)
    assert worth(own, pairs, chosen) == max(worth(own, pairs, each) for each in choices)


def test_two_that_cannot_be_together_are_not():
    own = [np.array([5.0, 3.0]), np.array([4.0])]
    assert best_assignment(own, {(0, 1): np.array([[-np.inf], [0.0]])}) == [1, 0]
    assert best_assignment(own, {(0, 1): np.full((2, 1), -np.inf)}) == [0, None]


def test_as_many_candidates_as_are_allowed_can_be_chosen_from_and_no_more():
    for objects in (1, 2, 5, 8):
        most = most_candidates(objects)
        assert (most + 1) ** objects <= MOST_ASSIGNMENTS < (most + 2) ** objects
    with pytest.raises(LocalizationError, match='list fewer objects'):
        best_assignment([np.zeros(20)] * 8, {})
