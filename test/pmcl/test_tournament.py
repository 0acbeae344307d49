"""The tournament of particle groups, on scores whose best pose is known."""

import numpy as np
import pytest
from pmcl_scenes import random_poses

from pmcl_ros.pmcl.motion import perturb
from pmcl_ros.pmcl.summary import rotation_distance
from pmcl_ros.pmcl.tournament import tournament

RADIUS = 0.06
BEST = random_poses(1, 0)[0]


def peak(poses, height=1000.0, best=BEST, across=0.002, about=0.05):
    """A hill about one pose, half as high 1.4 sigma away."""
    off = np.linalg.norm(poses[:, :3, 3] - best[:3, 3], axis=1) / across
    turn = rotation_distance(poses, best, None) / about
    return height / (1 + 0.5 * (off ** 2 + turn ** 2))


def starts(count, spread=0.015, seed=0):
    return perturb(np.tile(BEST, (count, 1, 1)), spread, 0.25, np.random.default_rng(seed))


def search(score, start, survivors=1, particles=192, moves=4, progress=lambda _: True, seed=0):
    return tournament(score, start, survivors, RADIUS, particles, moves, (0.006, 0.0004),
                      np.random.default_rng(seed), progress)


@pytest.mark.parametrize('seed', range(4))
def test_the_best_of_many_starts_is_found(seed):
    poses, scores = search(peak, starts(48, seed=seed), seed=seed)
    assert len(poses) == len(scores) == 1
    np.testing.assert_allclose(scores, peak(poses))
    assert np.linalg.norm(poses[0, :3, 3] - BEST[:3, 3]) < 0.002
    assert rotation_distance(poses, BEST, None)[0] < 0.04


def test_a_low_start_near_the_best_pose_outlives_high_ones_elsewhere():
    # Many starts on a broad low hill, and one at the foot of a narrow high one.
    elsewhere = random_poses(1, 5)[0]

    def score(poses):
        return np.maximum(peak(poses, 100, elsewhere, 0.05, 1.0), peak(poses))

    start = np.concatenate([np.tile(elsewhere, (30, 1, 1)), BEST[None]])
    start[-1, 0, 3] += 0.01
    assert score(start).argmax() < 30
    poses, _ = search(score, start, particles=2000)
    assert np.linalg.norm(poses[0, :3, 3] - BEST[:3, 3]) < 0.002


@pytest.mark.parametrize(('count', 'survivors', 'left'), [
    (1, 1, 1), (2, 4, 2), (16, 4, 4), (17, 4, 4), (48, 12, 12), (5, 2, 2)])
def test_survivors_are_as_many_as_wanted_best_first(count, survivors, left):
    _, scores = search(peak, starts(count), survivors, moves=1)
    assert len(scores) == left
    assert (np.diff(scores) <= 0).all()


@pytest.mark.parametrize('stop', [0, 3])
def test_progress_ends_it_with_what_was_found(stop):
    parts = []
    start = starts(16)
    poses, scores = search(peak, start, 1, 64,
                           progress=lambda part: (parts.append(part), len(parts) <= stop)[1])
    assert len(parts) == stop + 1
    assert parts[0] == 0
    assert (np.diff(parts) > 0).all()
    np.testing.assert_allclose(scores, peak(poses))
    assert scores[0] >= peak(start).max()
    if stop == 0:  # nothing has moved
        np.testing.assert_array_equal(poses[0], start[peak(start).argmax()])


def test_what_is_impossible_is_never_kept():
    def half(poses):
        return np.where(poses[:, 0, 3] > BEST[0, 3], peak(poses), -np.inf)

    start = starts(16)
    start[0] = BEST
    start[0, 0, 3] += 1e-4
    poses, scores = search(half, start)
    assert np.isfinite(scores).all()
    assert (poses[:, 0, 3] > BEST[0, 3]).all()


def test_the_same_seed_gives_the_same_poses():
    first, second, other = (search(peak, starts(8), seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first[0], second[0])
    assert (first[0] != other[0]).any()
