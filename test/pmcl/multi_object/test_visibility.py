"""What a contour's evidence is worth where others are too."""

import numpy as np
import pytest
from multi_object_scenes import BOTTLE, CUP, SETTINGS, seen_together, standing

from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.visibility import visible_evidence

FRONT, BEHIND = standing(-0.01, 0, 0.38), standing(0.02, 0.01, 0.47)


def observations(volume):
    """Of the cup in front, and the bottle behind it."""
    made = []
    for model, pose in ((CUP, FRONT), (BOTTLE, BEHIND)):
        with Localizer(model, SETTINGS) as localizer:
            made += localizer.observe(volume, [pose])
    return made


@pytest.fixture(scope='module')
def opaque():
    return observations(seen_together([(CUP, FRONT), (BOTTLE, BEHIND)]))


@pytest.fixture(scope='module')
def glass():
    return observations(seen_together([(CUP, FRONT), (BOTTLE, BEHIND)], through=True))


def total(points):
    return float(points.lengths @ points.evidence)


def test_alone_and_in_front_all_counts(opaque):
    front, behind = opaque
    for each, others in ((front, []), (behind, []), (front, [behind])):
        found = visible_evidence(each.points, others, 0.3)
        assert found.value == pytest.approx(total(each.points))
        assert found.share == pytest.approx(1)
        assert (found.weights == 1).all()


def test_what_is_hidden_says_nothing(opaque):
    front, behind = opaque
    found = visible_evidence(behind.points, [front], 0.3)
    column, row = np.rint(behind.points.pixels.T).astype(int)
    hidden = front.depth[row, column] > 0
    assert 0.1 < hidden.mean() < 0.9
    assert found.weights[hidden].max() < 0.01
    seen = float((behind.points.lengths * behind.points.evidence)[~hidden].sum())
    assert found.value == pytest.approx(seen, abs=5)
    assert found.value > total(behind.points) + 20


def test_what_is_seen_through_glass_counts(glass):
    front, behind = glass
    found = visible_evidence(behind.points, [front], 0.3)
    assert found.share > 0.9
    assert found.value == pytest.approx(total(behind.points), rel=0.1)


def test_one_edge_speaks_for_one_of_two(opaque):
    front, _ = opaque
    # The same contour a little farther away: all its edges are those of the nearer one.
    with Localizer(CUP, SETTINGS) as localizer:
        volume = seen_together([(CUP, FRONT)])
        near, far = localizer.observe(volume, [FRONT, standing(-0.01, 0, 0.383)])
    points = far.points
    assert total(points) > 100
    kept = visible_evidence(near.points, [far], 0.3)
    lost = visible_evidence(points, [near], 0.3)
    assert kept.value == pytest.approx(total(near.points), rel=0.15)
    assert lost.value < 0.4 * total(points)
    assert front.points.lengths.sum() > 100
