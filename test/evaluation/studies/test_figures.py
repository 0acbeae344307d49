"""Two superimposed layers: found where they are far apart, and in the order of Lemma 1."""

import numpy as np
import pytest

from pmcl_ros.evaluation.studies.figures import rates, two_layers


def test_the_texture_has_the_correlation_length_asked_for():
    centre = np.concatenate([two_layers(0, 1, 2.0, seed).centre_view ** (1 / 2.4) - 0.5
                             for seed in range(4)], axis=2)
    along = [np.mean(centre[:, :-k] * centre[:, k:]) / np.mean(centre ** 2) for k in (1, 2, 4)]
    np.testing.assert_allclose(along, np.exp(-0.5 * np.array([0.5, 1, 2]) ** 2), atol=0.2)


def test_layers_far_apart_are_both_found_and_close_ones_merge():
    assert rates(2, 0.5, 0.7).both > 0.9
    close = rates(0.2, 0.35, 1)
    assert close.both < 0.05
    assert rates(0.2, 0.35, 1, layers='joint').both > close.both + 0.9


def test_a_joint_fit_tells_no_two_of_a_single_layer():
    plain, joint = (rates(0, 1, 1, layers=each).several for each in ('volume', 'joint'))
    assert joint <= plain + 0.01


@pytest.mark.parametrize('alpha', [0.35, 0.65])
def test_the_layer_that_gives_more_light_is_the_more_likely_one(alpha):
    for found in (rates(2.5, alpha, 0.7), rates(0.3, alpha, 0.7, layers='joint')):
        assert found.both > 0.5
        assert found.ordered > 0.95
