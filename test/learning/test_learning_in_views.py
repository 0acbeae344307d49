"""What is learned from searches in several views, from deviations whose origin is known."""

from dataclasses import replace

import numpy as np
import pytest

from pmcl_ros.evidence.learned import NO_SLOPES, LearnedViews, SupportSlopes
from pmcl_ros.learning.posed_views import ViewsDeviation, ViewsSearch, fitted, learned_from
from pmcl_ros.learning.support_slopes import support_slopes
from pmcl_ros.runtime.errors import LocalizationError

DISPLACEMENT = 0.3  # px


def numbers(share, views, disagreement):
    return LearnedViews(least_evidence=0, least_support=0, support_slope=0, beyond_slope=0,
                        error_share=share, error_views=views, disagreement=disagreement)


def deviations(count, of, seed=0):
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        root = rng.normal(size=(5, 5))
        error, noise = root @ root.T, 0.05 * np.eye(5)
        views, apart = float(rng.uniform(1, 4)), float(rng.uniform(0, 2))
        spread = noise + of.share(views, apart) * error
        made.append(ViewsDeviation(rng.multivariate_normal(np.zeros(5), spread), noise, error,
                                   views, apart, rng.normal(0, DISPLACEMENT)))
    return made


@pytest.mark.parametrize('of', [numbers(0.3, 2.0, 1.5), numbers(1.0, 5.0, 0.4)])
def test_the_numbers_that_made_the_deviations_are_found(of):
    found = fitted(deviations(500, of))
    for views in (1.2, 2, 3.5):
        for apart in (0.2, 0.6, 1.5):
            assert found.share(views, apart) == pytest.approx(of.share(views, apart), rel=0.3)


def test_one_view_is_worth_what_is_known_and_many_what_is_seen():
    of = numbers(0.8, 3.0, 0.5).model_copy(update={'displacement': 0.3})
    assert of.share(1.0, 0.0) == 1
    assert of.displaced(1.0) == 0  # it is a part of the model error of one view
    assert of.displaced(2.0) == pytest.approx(0.3)
    assert of.share(1.4, 0.0) == pytest.approx(3.0 * 0.8 / 3.4, rel=0.01)
    assert of.share(1e6, 0.3) == pytest.approx(0.3 / 0.5, rel=1e-3)
    assert of.share(3.0, 0.1) < of.share(3.0, 0.2)


OF = numbers(0.4, 3.0, 1.0)
SPREAD = 0.5, 0.5, 0.2, 0.5  # of support, log(1 + Q), evidence beyond, inside


def found_and_elsewhere(count, seed=1):
    """Searches whose log odds grow by 4 a nat / px of support, and fall by 2 with log(1 + Q), by
    3.75 a nat / px beyond and by 2 of the inside."""
    rng = np.random.default_rng(seed)
    found = []
    for each in deviations(count, OF):
        support, apart, beyond, inside = rng.normal([1.2, 1.0, 0.6, 2.0], SPREAD)
        found.append(ViewsSearch(True, support, 1.7 + 0.3 * support, 1.0, np.expm1(max(apart, 0)),
                                 max(beyond, 0), each, inside))
    for _ in range(count):
        support, apart, beyond, inside = rng.normal([0.2, 1.5, 0.75, 2.5], SPREAD)
        found.append(ViewsSearch(False, support, 1.0, 1.0, np.expm1(max(apart, 0)),
                                 max(beyond, 0), None, inside))
    return found


@pytest.mark.parametrize('false_alarms', [0.05, 0.1])
def test_thresholds_are_between_objects_there_and_elsewhere(false_alarms):
    found = found_and_elsewhere(400)
    lines = []
    learned = learned_from(found, 0.95, false_alarms, 0.02, lines.append)
    over = {there: np.mean([
        each.support > learned.needed(3.0, each.disagreement, each.beyond, 9.0)
        - learned.slopes(3.0, SupportSlopes(9, 9, 9)).instead(each.evidence, 0.0, each.inside)
        for each in found if each.there == there]) for there in (False, True)}
    assert over[False] == pytest.approx(false_alarms, abs=0.01)
    assert over[True] > np.mean([each.support > np.quantile(
        [one.support for one in found if not one.there], 1 - false_alarms)
        for each in found if each.there])
    evidence = np.array([each.evidence for each in found if each.there])
    assert (evidence < learned.least_evidence).mean() == pytest.approx(0.02, abs=0.005)
    assert learned.share(2, 0.5) == pytest.approx(OF.share(2, 0.5), rel=0.5)
    drawn = np.array([each.deviation.displacement for each in found if each.there])
    assert learned.displacement == pytest.approx(np.sqrt(np.square(drawn).mean()), rel=0.05)
    assert any('truths in the 90 % region: 90 %' in line for line in lines)


def right_and_elsewhere():
    """Numbers (n, 3) of each kind, whose log odds grow by just 6, 4 and 2 log(2) for a unit."""
    points = np.stack(np.meshgrid(*[range(3)] * 3), axis=-1).reshape(-1, 3).astype(float)
    powers = (points @ (3, 2, 1)).astype(int)
    return [np.repeat(points, 2 ** each, axis=0) for each in (powers, powers.max() - powers)]


def test_slopes_are_ratios_of_the_odds_and_none_is_negative():
    right, elsewhere = right_and_elsewhere()
    # The ridge changes them by less.
    np.testing.assert_allclose(support_slopes(right, elsewhere), (4 / 6, 2 / 6), rtol=0.005)
    reverse = support_slopes(right * (1, 1, -1), elsewhere * (1, 1, -1))
    assert reverse[0] > 0.5
    assert reverse[1] == 0


@pytest.mark.parametrize('change', [(1, 1, 1), (1, 1, -1), (1, -1, 1)])
def test_slopes_do_not_depend_on_the_origin_and_go_with_the_units(change):
    groups = [each * change for each in right_and_elsewhere()]
    slopes = support_slopes(*groups)
    for offset in ((1, 1, 1), (5, 0, 0), (0, -20, 300), (-1000, 1000, 0)):
        np.testing.assert_allclose(
            support_slopes(*(each + offset for each in groups)), slopes, rtol=1e-6)
    for units in ((1e3, 1, 1), (1, 1e-3, 1), (1, 1, 50), (0.02, 7, 1e4)):
        np.testing.assert_allclose(support_slopes(*(each * units for each in groups)),
                                   slopes * units[0] / np.array(units[1:]), rtol=1e-6)


def test_support_that_tells_nothing_apart_is_refused():
    found = [ViewsSearch(there, each + (0.0 if there else 0.2), 1.7, 1.0, 0.0, 0.0)
             for there in (True, False) for each in np.linspace(0, 1, 20)]
    with pytest.raises(LocalizationError, match='20 right poses have no more support than 20'):
        support_slopes(*([[each.support, 0.0, 0.0] for each in group]
                         for group in (found[:20], found[20:])))


def test_an_ambiguous_pose_elsewhere_does_not_raise_the_threshold():
    found = [ViewsSearch(True, 1.0, 1.7, 1.0, 0.0, 0.0, each) for each in deviations(60, OF)]
    clear = found + [ViewsSearch(False, -0.5, 1.7, 1.0, 0.0, 0.0)] * 60
    ambiguous = found + [ViewsSearch(False, -0.5, 1.7, 1.0, 0.0, 0.0)] * 57 + [
        ViewsSearch(False, 2.0, 1.7, 0.6, 0.0, 0.0)] * 3
    one, other = (learned_from(each, 0.95, 0.05, 0.05, lambda _: None)
                  for each in (clear, ambiguous))
    assert one.least_support == other.least_support == -0.5


def test_the_model_error_is_of_the_poses_that_the_written_thresholds_claim():
    near = [replace(each, displacement=1.0) for each in deviations(40, OF)]
    found = [*[ViewsSearch(True, 1.002, 1.002, 1.0, 0.0, 0.0, each) for each in near],
             *[ViewsSearch(True, 3.0, 1.004, 1.0, 0.0, 0.0, each) for each in deviations(40, OF)],
             *[ViewsSearch(False, 1.004, 0.0, 1.0, 0.0, 0.0)] * 60]
    learned = learned_from(found, 0.95, 0.05, 0.5, lambda _: None)
    assert learned.least_support == learned.least_evidence == 1.0  # of 1.004 and 1.003
    all_of_them = [each.deviation.displacement for each in found if each.there]
    assert learned.displacement == round(np.sqrt(np.square(all_of_them).mean()), 2)


def test_views_that_disagree_need_more_support_and_views_of_one_place_as_much_as_one():
    of = numbers(0.8, 3.0, 0.5).model_copy(update={
        'least_support': -0.2, 'support_slope': 0.5, 'beyond_slope': 2.0})
    assert of.needed(1.0, 7.0, 1.0, 0.4) == 0.4
    assert of.needed(3.0, 0.0, 0.0, 0.4) == pytest.approx(-0.2)
    assert of.needed(3.0, np.expm1(2.0), 0.0, 0.4) == pytest.approx(0.8)
    assert of.needed(3.0, 0.0, 0.5, 0.4) == pytest.approx(0.8)
    alone = SupportSlopes(0.4, 0.2, 0.3)
    assert of.slopes(1.0, alone) == alone
    assert of.slopes(3.0, alone) == pytest.approx(NO_SLOPES)
    of = of.model_copy(update={'inside_slope': 0.7})
    assert of.slopes(1.0, alone) == alone
    assert of.slopes(3.0, alone) == pytest.approx(SupportSlopes(inside=0.7))


def test_too_few_searches_are_refused():
    with pytest.raises(LocalizationError, match='learn from more scenes'):
        learned_from([ViewsSearch(True, 1.0, 1.7, 1.0, 0.0, 0.0)], 0.95, 0.05, 0.05,
                     lambda _: None)
