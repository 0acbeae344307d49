"""The pilot sample, on densities that are known."""

import numpy as np
import pytest
from pmcl_scenes import random_poses
from test_sampler import AXIS, covariance_of, density

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.sampler import Gaussian, sample_posterior
from pmcl_ros.pmcl.summary import same_mode, tangent, tangent_basis
from pmcl_ros.pmcl.tracking.pilot import piloted

OFF = 1.5  # standard deviations that the likeness lies beside the density


def beside(pose, covariance, axis, seed):
    """A pose so many standard deviations away."""
    basis = tangent_basis(pose, axis)
    direction = np.random.default_rng([1, seed]).normal(size=basis.shape[1])
    root = np.linalg.cholesky(basis.T @ covariance @ basis)
    step = basis @ root @ direction * OFF / np.linalg.norm(direction)
    return retract(pose, step[None])[0]


@pytest.mark.parametrize('axis', [None, AXIS], ids=['whole', 'symmetric'])
@pytest.mark.parametrize('seed', range(4))
def test_what_a_density_says_more_is_learned(axis, seed):
    pose, target = random_poses(1, seed)[0], covariance_of(seed)
    other = beside(pose, target, axis, seed)

    def exact(poses):
        return density(pose, target, axis, poses) + 100

    start = Gaussian.of(other, 2 * target, axis)
    tilted, begun = piloted(lambda each: density(other, target, axis, each), exact, [start], axis,
                            np.random.default_rng(seed))
    # Two Gaussians alike but for their place differ by a plane: then nothing is left.
    normal = np.random.default_rng([2, seed]).normal(size=(200, start.basis.shape[1]))
    near = retract(pose, Gaussian.of(pose, target, axis).deviations(normal))
    left = tilted(near) - exact(near)
    assert left.std() < 0.1 * OFF
    assert abs(left.mean()) < 0.2
    # It begins nearer than it did, and wider than the density.
    truth = Gaussian.of(pose, target, axis)
    assert truth.square_distance(begun[0].pose[None], axis)[0] < 0.7 ** 2
    wide = np.linalg.solve(truth.spread, begun[0].spread)
    assert np.linalg.svd(wide)[1].min() > 1


def test_few_particles_come_to_a_density_that_is_beside_its_likeness():
    pose, target = random_poses(1, 7)[0], covariance_of(7)
    other = beside(pose, target, None, 7)
    truth, start = Gaussian.of(pose, target, None), Gaussian.of(other, 2 * target, None)

    def rough(poses):
        return density(other, target, None, poses)

    def exact(poses):
        return density(pose, target, None, poses)

    means = {True: [], False: []}
    for seed in range(30):
        for pilot, found in means.items():
            rng = np.random.default_rng(seed)
            likeness, begun = (piloted(rough, exact, [start], None, rng) if pilot
                               else (rough, [start]))
            poses, _, _ = sample_posterior([likeness, exact], begun, None, 64, 1, rng,
                                           lambda _: True)
            found.append((tangent(poses, pose, None) @ truth.basis).mean(axis=0))
    off = {pilot: np.linalg.norm(np.linalg.solve(truth.spread, np.mean(found, axis=0)))
           for pilot, found in means.items()}
    assert off[True] < 0.15
    assert off[True] < 0.5 * off[False]


def test_modes_are_learned_apart_and_those_with_few_pilots_left_alone():
    first, second, third = random_poses(3, 5)
    target = covariance_of(0)
    assert not same_mode(np.stack([second, third]), first, None, 0.01, 0.1).any()
    heights = {id(first): 0.0, id(second): 1.0, id(third): -60.0}

    def rough(poses):
        return np.logaddexp.reduce([density(each, target, None, poses) + (each is third) * -60
                                    for each in (first, second, third)])

    def exact(poses):
        return np.logaddexp.reduce([density(each, target, None, poses) + heights[id(each)]
                                    for each in (first, second, third)])

    starts = [Gaussian.of(each, 2 * target, None) for each in (first, second, third)]
    tilted, begun = piloted(rough, exact, starts, None, np.random.default_rng(0))
    at = np.stack([first, second])
    np.testing.assert_allclose(np.diff(tilted(at)), np.diff(exact(at)), atol=0.2)
    assert begun[2] is starts[2]
    assert np.isfinite(tilted(third[None])).all()


def test_a_density_that_says_nothing_anywhere_changes_nothing():
    pose, target = random_poses(1, 0)[0], covariance_of(0)

    def rough(poses):
        return density(pose, target, None, poses)

    start = Gaussian.of(pose, 2 * target, None)
    tilted, _ = piloted(rough, lambda each: np.full(len(each), -np.inf), [start], None,
                        np.random.default_rng(0))
    poses = random_poses(5, 3)
    np.testing.assert_allclose(tilted(poses), rough(poses))
