"""The joint assignment has the largest value of all, and of what can be there together."""

from dataclasses import replace
from functools import lru_cache
from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from multi_object_scenes import BOTTLE, CUP, SETTINGS, seen_together, standing

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.candidates import (
    MOST_ASSIGNMENTS,
    Candidates,
    best_assignment,
    most_candidates,
    support_beside,
)
from pmcl_ros.pmcl.multi_object.penetration import Interior, PlacedObject, resolve_penetration
from pmcl_ros.pmcl.multi_object.visibility import visible_evidence
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


LEFT, RIGHT, BEHIND = standing(-0.04, 0, 0.42), standing(0.035, 0.01, 0.4), standing(0, 0, 0.49)
ASIDE = retract(LEFT, np.array([[0.012, 0, 0, 0, 0, 0]]))[0]  # as a cup is wide, in its place
TOUCHING = 0.06  # m: between two cups, of which the one is 3 mm deep in the other


@lru_cache  # not made while tests are collected, which every worker does
def interiors():
    return [Interior.from_model(each) for each in (CUP, BOTTLE)]


@pytest.fixture(scope='module')
def observed():
    """Two cups, one as if it had half of its evidence in another pose too, and a bottle."""
    seen = seen_together([(CUP, LEFT), (CUP, RIGHT), (BOTTLE, BEHIND)], through=True)
    with Localizer(CUP, SETTINGS) as cups, Localizer(BOTTLE, SETTINGS) as bottles:
        left, right = cups.observe(seen, [LEFT, RIGHT])
        aside = replace(left, pose=ASIDE, local=replace(
            left.local, evidence=left.local.evidence / 2))
        return (left, right, aside), bottles.observe(seen, [BEHIND])


def candidates(listed, cups, bottles=(), least=0.0, least_support=-1e3):
    made = Candidates([CUP, BOTTLE], interiors(), listed, least, least_support)
    return made, [made.add(0, cups), made.add(1, bottles)]


def test_a_pose_is_one_candidate_and_the_best_of_the_first_search_gives_the_scale(observed):
    (left, right, _), _ = observed
    best = max(left, right, key=lambda each: each.local.evidence)
    made, (first, _) = candidates([0], [left, right])
    assert first == [(0, 0), (0, 1)]
    spun = retract(LEFT, np.array([[0.001, 0, 0, *(LEFT[:3, :3] @ CUP.axis)]]))[0]
    better = replace(left, pose=spun, local=replace(left.local, evidence=1e6, length=7.0,
                                                    variability=9 * left.local.variability))
    assert better.local.scale != best.local.scale
    assert made.add(0, [better, replace(better, pose=ASIDE)]) == [(0, 0), (0, 2)]
    assert made[0, 0] is left
    assert made.scale(0) == best.local.scale


def test_a_candidate_is_worth_what_it_has_above_the_least_evidence(observed):
    (left, right, _), (bottle,) = observed
    for cup in (left, right):
        mean = cup.local.evidence / cup.local.length
        for part, there in ((0.9, True), (1.1, False)):
            made, ((member,), _) = candidates([0], [cup], least=part * mean)
            assert made.value(member, []) == pytest.approx(
                (1 - part) * cup.local.scale * cup.local.evidence)
            assert made.assigned() == [member if there else None]
    # A bottle behind no other changes nothing of it; each is there once only.
    made, (cups, (other,)) = candidates([0, 0, 1], [left, right], [bottle])
    assert made.value(cups[0], cups[1:]) == pytest.approx(made.value(cups[0], []))
    assert made.value(cups[0], cups[:1]) == -np.inf
    assert made.value(cups[0], [other]) == made.value(cups[0], []) + (
        made.value(other, [cups[0]]) - made.value(other, []))
    assert sorted(made.assigned()[:2]) == cups
    assert made.assigned()[2] == other


def test_two_in_one_place_are_not_both_there_and_the_better_one_is(observed):
    (left, right, aside), _ = observed
    made, (members, _) = candidates([0, 0], [aside, left])
    assert made.value(*members[:1], members[1:]) == -np.inf
    assert sorted(made.assigned(), key=str) == [members[1], None]
    made, (members, _) = candidates([0, 0, 0], [aside, left, right])
    assert sorted(made.assigned(), key=str) == [*members[1:], None]


def test_of_many_poses_the_best_ones_are_candidates_in_whatever_order_they_were_found(observed):
    (left, _, _), _ = observed
    worse = [replace(left, pose=standing(0, 0.1 * k, 0.5), local=replace(
        left.local, evidence=left.local.evidence / 2)) for k in range(20)]
    made, (members, _) = candidates([0, 0], [*worse, left])
    assert members[-1] in made.assigned()


def test_what_is_no_object_takes_the_worse_poses_in_its_place_with_it(observed):
    (left, right, aside), _ = observed
    made, (members, _) = candidates([0], [left, right, aside])
    made.exclude(members[2])  # no better one in its place
    made.exclude(members[1])
    assert made.assigned() == [members[0]]
    made, (members, _) = candidates([0, 0], [left, right, aside])
    made.exclude(members[0])
    assert sorted(made.assigned(), key=str) == [members[1], None]
    # So does one that has no support: it is out of view but for a little.
    least = min(support_beside(each, [], 1.0, 0.0) for each in (right, aside))
    hidden = replace(left, in_view=1e-3)
    made, (members, _) = candidates([0, 0], [hidden, right, aside], least_support=least - 0.1)
    assert made.support(members[0], []) < least - 100
    assert sorted(made.assigned(), key=str) == [members[1], None]


def test_what_had_no_support_beside_another_is_there_once_that_one_is_not(observed):
    """A tenth of its contour is its own; the edges along the rest are those of a cup before it."""
    (left, _, _), _ = observed
    own = np.zeros((len(left.points.pixels), 2))
    own[::10] = 5  # px
    points = replace(left.points, depths=left.points.depths + 0.001,
                     pixels=left.points.pixels + own, evidence=0.9 * left.points.evidence)
    behind = replace(left, pose=standing(-0.04, 0, 0.6), points=points, local=replace(
        left.local, evidence=0.9 * left.local.evidence))
    made, ((cup,), (other,)) = candidates([1, 0], [left], [behind], least_support=-5)
    assert made.value(other, [cup]) > 0
    assert made.support(other, [cup]) < -5 < made.support(other, [])
    assert made.assigned() == [None, cup]
    made.exclude(cup)
    assert made.assigned() == [other, None]
    made.exclude(other)
    assert made.assigned() == [None, None]


def test_what_is_more_likely_absent_has_no_support_and_what_is_hidden_is_out_of_view(observed):
    (left, right, _), _ = observed
    mean = left.points.lengths @ left.points.evidence / left.points.lengths.sum()
    assert support_beside(left, [], 1.0, 0.99 * mean) == support_beside(left, [right], 1.0, -9)
    assert support_beside(left, [], 1.0, 1.01 * mean) == -np.inf
    # Before a bottle, which no picture shows through it, stands a cup: the hidden part costs what
    # it would cost out of view, one nat for each pixel.
    front = standing(-0.02, 0.01, 0.36)
    with Localizer(CUP, SETTINGS) as cups, Localizer(BOTTLE, SETTINGS) as bottles:
        seen = seen_together([(CUP, front), (BOTTLE, BEHIND)])
        cup, = cups.observe(seen, [front])
        behind, = bottles.observe(seen, [BEHIND])
    share = visible_evidence(behind.points, [cup], 0.3).share
    assert share < 0.9
    for others, part in (([], 1.0), ([cup], share)):
        whole, half = (support_beside(replace(behind, in_view=each), others, 0.3, -9)
                       for each in (1.0, 0.5))
        assert whole - half == pytest.approx(1 / part)
    assert support_beside(behind, [cup], 0.3, -9) > support_beside(behind, [], 0.3, -9)
    # What is hidden is no reason to take the rest for absent.
    mean = behind.points.lengths @ behind.points.evidence / behind.points.lengths.sum()
    assert support_beside(behind, [], 0.3, mean + 0.01) == -np.inf
    assert support_beside(behind, [cup], 0.3, mean + 0.01) > -np.inf
    # Together both are worth what is seen of them.
    made, ((one,), (other,)) = candidates([0, 1], [cup], [behind])
    gains = [scale * (visible_evidence(each.points, [beside], scale).value
                      - each.points.lengths @ each.points.evidence)
             for each, beside, scale in ((cup, behind, made.scale(0)),
                                         (behind, cup, made.scale(1)))]
    assert sum(gains) > 10
    assert made.value(other, [one]) - made.value(other, []) == pytest.approx(sum(gains))


def test_to_be_moved_apart_costs_two_as_much_as_they_are_sure(observed):
    (left, _, _), _ = observed
    beside = retract(LEFT, np.array([[TOUCHING, 0, 0, 0, 0, 0]]))[0]
    values, costs = [], []
    for sigma in (0.001, 0.003):
        wide = replace(left.local, model_error=sigma ** 2 * np.eye(len(left.local.gradient)))
        both = [replace(left, pose=pose, local=wide) for pose in (LEFT, beside)]
        made, ((one, other), _) = candidates([0, 0], both)
        values.append(made.value(one, [other]))
        costs.append(resolve_penetration([PlacedObject(interiors()[0], each.pose, each.covariance)
                                          for each in both]).cost)
    assert costs[0] > 2 * costs[1] > 0
    assert values[1] - values[0] == pytest.approx(costs[0] - costs[1])


def test_two_are_both_there_if_to_move_them_apart_costs_less_than_the_worse_one_is_worth(observed):
    (left, _, _), _ = observed
    beside = retract(LEFT, np.array([[TOUCHING + 0.0015, 0, 0, 0, 0, 0]]))[0]
    sure = replace(left.local, model_error=1e-8 * np.eye(len(left.local.gradient)))
    cup, worse = (replace(left, pose=pose, local=sure) for pose in (LEFT, beside))
    cost = resolve_penetration([PlacedObject(interiors()[0], each.pose, each.covariance)
                                for each in (cup, worse)]).cost
    assert cost < 0.1 * sure.evidence
    for part, there in ((1.1, True), (0.9, False)):
        worse = replace(worse, local=replace(sure, evidence=part * cost / sure.scale))
        made, ((one, other), _) = candidates([0, 0], [cup, worse])
        assert np.isfinite(made.value(one, [other])) == there
    # They are as deep in each other as may be: what is one of them says nothing of the other.
    made.exclude(one)
    assert other in made.assigned()


def test_two_that_nothing_moves_apart_are_not_both_there(observed):
    """Only how they are turned is not sure."""
    (left, _, aside), _ = observed
    basis = left.local.basis
    turned = basis.T @ np.diag([0, 0, 0, 1e6, 1e6, 1e6]) @ basis
    # The last points are corners, and what is inside: they are enough, and quickly compared.
    quick = [replace(each, samples=each.samples[-60:], sample_normals=each.sample_normals[-60:])
             for each in interiors()]
    made = Candidates([CUP, BOTTLE], quick, [0, 0], 0.0, -1e3)
    one, other = made.add(0, [replace(each, local=replace(each.local, model_error=turned))
                              for each in (left, aside)])
    assert made.value(one, [other]) == -np.inf
