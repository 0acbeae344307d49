"""Weights, resampling, and the draws and perturbations of poses, against their distributions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from pmcl_ros.pmcl.particles import Weights, perturb, uniform_poses
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.runtime.errors import LocalizationError

LOGS = arrays(float, st.integers(1, 60), elements=st.floats(-800, 800) | st.just(-np.inf))


@settings(max_examples=100, deadline=None)
@given(LOGS, st.floats(-500, 500))
def test_weights_are_a_softmax_whatever_is_added(log, shift):
    weights = Weights(log + shift)
    assert weights.normalised.sum() == pytest.approx(1)
    if np.isfinite(log.max()):
        share = np.exp(log - log.max())
        np.testing.assert_allclose(weights.normalised, share / share.sum(), atol=1e-12)
        assert weights.log.max() == 0
        np.testing.assert_allclose(weights.log_normalised, log - np.logaddexp.reduce(log),
                                   atol=1e-9)
    else:
        np.testing.assert_allclose(weights.normalised, 1 / len(log))


@settings(max_examples=100, deadline=None)
@given(LOGS)
def test_effective_size_is_between_one_and_all(log):
    size = Weights(log).effective_size
    assert 1 - 1e-9 <= size <= len(log) * (1 + 1e-9)


def test_effective_size_by_example():
    assert Weights(np.zeros(7)).effective_size == pytest.approx(7)
    assert Weights(np.array([0, -np.inf, -1e9])).effective_size == pytest.approx(1)
    assert Weights.from_values(np.array([1, 1, 1, 0.0])).effective_size == pytest.approx(3)


def test_nan_is_no_weight_and_no_weights_are_equal_ones():
    np.testing.assert_allclose(Weights(np.array([np.nan, 0, 0])).normalised, [0, 0.5, 0.5])
    for none in ([-np.inf, -np.inf], [np.nan, np.nan], [np.nan, -np.inf]):
        np.testing.assert_allclose(Weights(np.array(none)).normalised, 0.5)
    np.testing.assert_allclose(Weights.from_values(np.array([0, 3, 1, -2, np.nan])).normalised,
                               [0, 0.75, 0.25, 0, 0])
    np.testing.assert_allclose(Weights.from_values(np.zeros(4)).normalised, 0.25)


@pytest.mark.parametrize('log', [np.zeros(0), np.zeros((2, 2)), np.array(1.0)])
def test_weights_are_one_row(log):
    with pytest.raises(LocalizationError, match='one row of numbers'):
        Weights(log)


@settings(max_examples=100, deadline=None)
@given(arrays(float, st.integers(2, 60), elements=st.floats(-300, 300), unique=True),
       st.floats(0.05, 1), st.floats(0.01, 10))
def test_tempering_reaches_its_share_or_its_cap(scores, effective, largest):
    weights, taken = Weights.tempered(scores, largest, effective)
    assert 0 <= taken <= largest
    np.testing.assert_allclose(weights.log, Weights(taken * scores).log)
    capped = Weights(largest * scores)
    if capped.effective_size >= effective * len(scores):
        np.testing.assert_array_equal(weights.log, capped.log)
        return
    assert weights.effective_size >= effective * len(scores) * (1 - 1e-9)
    # The log weights are beta times the scores, beta as large as the share allows.
    beta = -weights.log.min() / np.ptp(scores)
    np.testing.assert_allclose(weights.log, beta * (scores - scores.max()), atol=1e-9)
    harder = Weights((beta * 1.001 + 1e-9 * largest) * scores)
    assert harder.effective_size <= effective * len(scores) * (1 + 1e-9)


@pytest.mark.filterwarnings('error')
def test_tempering_leaves_out_what_is_impossible():
    scores = np.array([-np.inf, 3.0, np.nan, 3.0, -np.inf, 2.0])
    weights, _ = Weights.tempered(scores, 5, 0.3)
    np.testing.assert_array_equal(weights.normalised[[0, 2, 4]], 0)
    assert weights.effective_size >= 0.3 * 6
    # Three cannot be four effective: they get equal weights.
    np.testing.assert_allclose(Weights.tempered(scores, 5, 0.7)[0].normalised[[1, 3, 5]], 1 / 3)
    np.testing.assert_allclose(Weights.tempered(np.full(3, -np.inf), 5, 0.7)[0].normalised, 1 / 3)


@settings(max_examples=200, deadline=None)
@given(LOGS, st.integers(1, 300), st.integers(0, 2 ** 31))
def test_systematic_resampling_draws_each_its_share(log, count, seed):
    weights = Weights(log)
    drawn = weights.resample(count, np.random.default_rng(seed))
    assert drawn.shape == (count,)
    counts = np.bincount(drawn, minlength=len(log))
    assert (np.abs(counts - count * weights.normalised) < 1 + 1e-6).all()
    assert (counts[weights.normalised == 0] == 0).all()


class _First:
    """A generator of the smallest or largest number that there is."""

    def __init__(self, value):
        self.value = value

    def random(self):
        return self.value


@pytest.mark.parametrize('value', [0.0, 1 - 2 ** -53])
def test_no_weight_is_never_drawn_at_either_end(value):
    weights = Weights(np.log([1e-300, 0.3, 0.3, 0.4, 1e-300]))
    weights = Weights(np.where(weights.log < -600, -np.inf, weights.log))
    for count in (1, 3, 1000):
        drawn = weights.resample(count, _First(value))
        assert set(drawn) <= {1, 2, 3}


def test_resampling_is_unbiased():
    weights = Weights.from_values(np.array([0.15, 0.6, 0.05, 0.2]))
    rng = np.random.default_rng(0)
    drawn = np.concatenate([weights.resample(3, rng) for _ in range(4000)])
    share = np.bincount(drawn, minlength=4) / len(drawn)
    np.testing.assert_allclose(share, weights.normalised, atol=0.01)


REGION = Region((0.1, -0.2, 0.6), (0.2, 0.1, 0.05))
COUNT = 20_000


def assert_poses(poses):
    turns = poses[:, :3, :3]
    identity = np.broadcast_to(np.eye(3), turns.shape)
    np.testing.assert_allclose(turns @ turns.swapaxes(1, 2), identity, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turns), 1)
    np.testing.assert_array_equal(poses[:, 3], np.broadcast_to([0, 0, 0, 1], (len(poses), 4)))


def test_positions_are_uniform_in_the_region():
    poses = uniform_poses(REGION, COUNT, np.random.default_rng(0))
    assert_poses(poses)
    assert REGION.contains(poses[:, :3, 3]).all()
    unit = (poses[:, :3, 3] - REGION.center) / REGION.size + 0.5
    for axis in unit.T:
        assert kstest(axis, 'uniform').pvalue > 1e-3
    np.testing.assert_allclose(np.corrcoef(unit.T), np.eye(3), atol=0.03)


def test_orientations_are_uniform_over_all_rotations():
    turns = uniform_poses(REGION, COUNT, np.random.default_rng(1))[:, :3, :3]
    for axis in range(3):
        # By Archimedes each coordinate of a uniform direction is uniform.
        for coordinate in turns[:, :, axis].T:
            assert kstest(coordinate, 'uniform', (-1, 2)).pvalue > 1e-3
    # The angle of a uniform rotation has density (1 - cos) / pi.
    angle = Rotation.from_matrix(turns).magnitude()
    assert kstest(angle, lambda a: (a - np.sin(a)) / np.pi).pvalue > 1e-3


def test_the_same_seed_gives_the_same_poses():
    first, second = (uniform_poses(REGION, 9, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_perturbation_is_gaussian_with_its_deviations_about_the_camera_axes():
    poses = uniform_poses(REGION, COUNT, np.random.default_rng(2))
    before = poses.copy()
    along, about = np.array([0.001, 0.002, 0.01]), np.array([0.03, 0.01, 0.002])
    moved = perturb(poses, along, about, np.random.default_rng(3))
    np.testing.assert_array_equal(poses, before)
    assert_poses(moved)
    turn = Rotation.from_matrix(moved[:, :3, :3] @ poses[:, :3, :3].swapaxes(1, 2)).as_rotvec()
    deviations = np.hstack([moved[:, :3, 3] - poses[:, :3, 3], turn]) / np.hstack([along, about])
    for each in deviations.T:
        assert kstest(each, 'norm').pvalue > 1e-3
    np.testing.assert_allclose(np.cov(deviations.T), np.eye(6), atol=0.05)


def test_no_deviation_is_no_motion():
    poses = uniform_poses(REGION, 50, np.random.default_rng(4))
    np.testing.assert_allclose(perturb(poses, 0.0, 0.0, np.random.default_rng(5)), poses,
                               atol=1e-15)
