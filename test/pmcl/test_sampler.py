"""The sampler, on posteriors that are known."""

import numpy as np
import pytest
from pmcl_scenes import random_poses
from scipy.stats import multivariate_normal

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.sampler import Gaussian, sample_posterior

NONE, ROUND = Symmetry(), Symmetry(np.array([0, 0, 1.0]))
SIGMA = np.array([0.001, 0.0005, 0.004, 0.02, 0.03, 0.01])


def covariance_of(seed):
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    mixed = 0.5 * np.eye(6) + 0.5 * turn @ np.diag(rng.uniform(0.1, 2, 6)) @ turn.T
    return SIGMA[:, None] * mixed * SIGMA


def density(pose, covariance, symmetry, poses):
    basis = symmetry.tangent_basis(pose)
    deviations = symmetry.local(poses, pose) @ basis
    inverse = np.linalg.inv(basis.T @ covariance @ basis)
    return -0.5 * np.einsum('ni,ij,nj->n', deviations, inverse, deviations)


@pytest.mark.parametrize('symmetry', [NONE, ROUND], ids=['whole', 'symmetric'])
def test_a_density_is_normalised_and_the_same_in_the_frame_of_another_camera(symmetry):
    pose, camera = random_poses(2, 3)
    poses = retract(pose, np.random.default_rng(0).normal(size=(20, 6)) * SIGMA)
    off = []
    for covariance in (covariance_of(0), 4 * covariance_of(1)):
        gaussian = Gaussian.from_covariance(pose, covariance, symmetry)
        basis, found = gaussian.basis, gaussian.log_density(poses)
        off.append(found - multivariate_normal(cov=basis.T @ covariance @ basis).logpdf(
            symmetry.local(poses, pose) @ basis))
        seen = gaussian.seen_from(camera)
        np.testing.assert_allclose(seen.log_density(np.linalg.inv(camera) @ poses), found)
    np.testing.assert_allclose(off, off[0][0])  # the constant of all Gaussians


@pytest.mark.parametrize('symmetry', [NONE, ROUND], ids=['whole', 'symmetric'])
@pytest.mark.parametrize('seed', range(3))
def test_a_gaussian_is_sampled_with_its_mean_and_covariance(symmetry, seed):
    pose, target = random_poses(1, seed)[0], covariance_of(seed)
    basis = symmetry.tangent_basis(pose)
    # The start is off by a standard deviation, and three times as wide.
    start = retract(pose, (basis @ basis.T @ SIGMA)[None])[0]
    poses, values, own = sample_posterior(
        [lambda each: density(pose, target, symmetry, each)],
        [Gaussian.from_covariance(start, 9 * target, symmetry)],
        1500, 6, np.random.default_rng(seed), lambda _: True)
    np.testing.assert_allclose(values, density(pose, target, symmetry, poses), atol=1e-6)
    assert (own == 0).all()
    deviations = symmetry.local(poses, pose) @ basis
    expected = basis.T @ target @ basis
    scale = np.sqrt(np.diag(expected))
    assert (np.abs(deviations.mean(axis=0)) < 0.25 * scale).all()
    found = np.cov(deviations.T) / np.outer(scale, scale)
    np.testing.assert_allclose(found, expected / np.outer(scale, scale), atol=0.3)


def test_modes_share_the_particles_as_the_posterior_does():
    first, second = random_poses(2, 5)
    assert not NONE.same_mode(second[None], first, 0.01, 0.1)[0]
    target = covariance_of(0)

    def two(poses):  # three to one
        return np.logaddexp(np.log(3) + density(first, target, NONE, poses),
                            density(second, target, NONE, poses))

    shares = []
    for seed in range(4):
        _, _, own = sample_posterior(
            [two],
            [Gaussian.from_covariance(each, 4 * target, NONE) for each in (second, first)], 600, 3,
            np.random.default_rng(seed), lambda _: True)
        shares.append((own == 1).mean())
    assert np.mean(shares) == pytest.approx(0.75, abs=0.06)


def test_what_is_impossible_is_left_out_and_stopping_is_heard():
    pose, target = random_poses(1, 0)[0], covariance_of(0)

    def half(poses):
        return np.where(poses[:, 0, 3] > pose[0, 3], density(pose, target, NONE, poses), -np.inf)

    start = [Gaussian.from_covariance(pose, 4 * target, NONE)]
    poses, values, _ = sample_posterior([half], start, 300, 3, np.random.default_rng(0),
                                        lambda _: True)
    assert np.isfinite(values).all()
    assert (poses[:, 0, 3] > pose[0, 3]).all()
    calls = []
    stopped, _, _ = sample_posterior([half], start, 300, 3, np.random.default_rng(0),
                                     lambda part: calls.append(part))
    assert calls == [0]
    assert len(stopped) == 300


def test_a_rough_density_on_the_way_changes_nothing_but_the_cost():
    pose, target = random_poses(1, 1)[0], covariance_of(1)
    beside = retract(pose, 0.5 * SIGMA[None])[0]
    asked = []

    def exact(poses):
        asked.append(len(poses))
        return density(pose, target, ROUND, poses)

    def rough(poses):
        return density(beside, 1.5 * target, ROUND, poses)

    basis = ROUND.tangent_basis(pose)
    expected = basis.T @ target @ basis
    scale = np.sqrt(np.diag(expected))
    costs = []
    for densities in ([exact], [rough, exact]):
        asked.clear()
        poses, values, _ = sample_posterior(
            densities, [Gaussian.from_covariance(beside, 9 * target, ROUND)], 1500, 6,
            np.random.default_rng(0), lambda _: True)
        costs.append(sum(asked))
        np.testing.assert_allclose(values, density(pose, target, ROUND, poses), atol=1e-6)
        deviations = ROUND.local(poses, pose) @ basis
        assert (np.abs(deviations.mean(axis=0)) < 0.25 * scale).all()
        np.testing.assert_allclose(np.cov(deviations.T) / np.outer(scale, scale),
                                   expected / np.outer(scale, scale), atol=0.3)
    assert costs[1] < 0.7 * costs[0]


@pytest.mark.parametrize('modes', [1, 2, 3])
def test_each_modes_particles_begin_evenly(modes):
    places, target, size = random_poses(modes, 7), covariance_of(1), 60
    starts = [Gaussian.from_covariance(each, target, NONE) for each in places]
    means = []
    for seed in range(12):
        begun = []
        sample_posterior([lambda poses: np.zeros(len(poses))], starts, size * modes, 1,
                         np.random.default_rng(seed), lambda _: False,
                         [lambda poses, _, begun=begun: begun.append(poses)])
        for k, start in enumerate(starts):
            # The particles of a mode follow each other.
            off = NONE.local(begun[0][k * size:(k + 1) * size], start.pose) @ start.basis
            normal = np.linalg.solve(start.spread, off.T)
            means.append(normal.mean(axis=1))
            assert np.cov(normal) == pytest.approx(np.eye(6), abs=0.6)
    # Of random numbers it would be 1.
    assert np.sqrt(np.mean(np.square(means)) * size) < 0.6


def test_poses_are_feasible_where_hardly_any_of_the_start_is():
    pose, half = random_poses(1, 0)[0], 1e-4

    def box(poses):
        inside = (np.abs(poses[:, :3, 3] - pose[:3, 3]) < half).all(axis=1)
        return np.where(inside, 0.0, -np.inf)

    wide = Gaussian.from_covariance(pose, np.diag(np.full(6, 0.5 ** 2)), NONE)
    poses, values, _ = sample_posterior([box], [wide], 32, 3, np.random.default_rng(0),
                                        lambda _: True)
    np.testing.assert_array_equal(values, 0)
    assert (np.abs(poses[:, :3, 3] - pose[:3, 3]) < half).all()
