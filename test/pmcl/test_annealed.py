"""The tournament of particle groups, on scores whose best pose is known."""

import numpy as np
import pytest
from pmcl_scenes import random_poses
from scipy.spatial.transform import Rotation

from pmcl_ros.pmcl.annealed import annealed_filter
from pmcl_ros.pmcl.motion import perturb
from pmcl_ros.pmcl.summary import rotation_distance

RADIUS = 0.06
BEST = random_poses(1, 0)[0]


def go_on(_):
    return True


def peak(poses, height=1000.0, best=BEST, across=0.002, about=0.05):
    """A hill about one pose, half as high 1.4 sigma away."""
    off = np.linalg.norm(poses[:, :3, 3] - best[:3, 3], axis=1) / across
    turn = rotation_distance(poses, best, None) / about
    return height / (1 + 0.5 * (off ** 2 + turn ** 2))


def starts(count, spread=0.015, seed=0):
    return perturb(np.tile(BEST, (count, 1, 1)), spread, 0.25, np.random.default_rng(seed))


def search(score, start, particles=192, moves=3, progress=go_on, seed=0, coarse=None):
    return annealed_filter(coarse or score, score, start, RADIUS, particles, moves,
                           np.random.default_rng(seed), progress)


@pytest.mark.parametrize('seed', range(4))
def test_particles_end_at_the_best_pose(seed):
    poses, scores = search(peak, starts(48, seed=seed), seed=seed)
    assert len(poses) == len(scores) == 192
    np.testing.assert_allclose(scores, peak(poses))
    best = poses[scores.argmax()]
    assert np.linalg.norm(best[:3, 3] - BEST[:3, 3]) < 0.0015
    assert rotation_distance(best[None], BEST, None)[0] < 0.03
    assert np.median(scores) > 800


def test_a_low_start_near_the_best_pose_outlives_high_ones_elsewhere():
    # A hundred starts on a broad low hill, and one at the foot of a narrow high one.
    elsewhere = random_poses(1, 5)[0]

    def score(poses):
        return np.maximum(peak(poses, 100, elsewhere, 0.05, 1.0), peak(poses))

    start = np.concatenate([np.tile(elsewhere, (100, 1, 1)), BEST[None]])
    start[-1, 0, 3] += 0.01
    assert score(start).argmax() < 100
    poses, scores = search(score, start, particles=2000)
    assert np.linalg.norm(poses[scores.argmax(), :3, 3] - BEST[:3, 3]) < 0.002


@pytest.mark.parametrize(('count', 'rounds'), [(1, 2), (2, 2), (3, 3), (48, 7), (64, 7)])
def test_progress_runs_from_zero_once_for_every_move(count, rounds):
    parts = []
    search(peak, starts(count), moves=2, progress=lambda part: parts.append(part) is None)
    np.testing.assert_allclose(parts, np.arange(2 * rounds) / (2 * rounds))


@pytest.mark.parametrize('stop', [0, 3, 10])
def test_progress_ends_the_search_with_the_best_group_so_far(stop):
    parts = []
    poses, scores = search(peak, starts(16), particles=64,
                           progress=lambda part: (parts.append(part), len(parts) <= stop)[1])
    assert len(parts) == stop + 1
    assert len(poses) == len(scores) > 0
    np.testing.assert_allclose(scores, peak(poses))
    if stop == 0:  # nothing has moved: the best start, its share of the particles times
        np.testing.assert_array_equal(poses, np.tile(starts(16)[peak(starts(16)).argmax()],
                                                     (4, 1, 1)))


def test_the_coarse_score_leads_and_the_fine_one_decides():
    other = BEST.copy()
    other[0, 3] += 0.004

    def coarse(poses):
        seen.append('coarse')
        return peak(poses, best=other)

    def fine(poses):
        seen.append('fine')
        return peak(poses)

    seen = []
    poses, scores = search(fine, starts(16), coarse=coarse)
    assert seen == sorted(seen)  # coarse before fine
    assert seen.count('coarse') == 2 * (1 + 3)
    assert seen.count('fine') == 3 * (1 + 3)
    assert np.linalg.norm(poses[scores.argmax(), :3, 3] - BEST[:3, 3]) < 0.0015


def test_what_is_impossible_is_never_drawn():
    def half(poses):
        return np.where(poses[:, 0, 3] > BEST[0, 3], peak(poses), -np.inf)

    start = starts(16)
    start[0] = BEST
    start[0, 0, 3] += 1e-4
    poses, scores = search(half, start)
    assert np.isfinite(scores).all()
    assert (poses[:, 0, 3] > BEST[0, 3]).all()


@pytest.mark.parametrize('value', [0.0, -np.inf])
def test_scores_that_say_nothing_are_survived(value):
    poses, scores = search(lambda poses: np.full(len(poses), value), starts(5), particles=20)
    assert np.isfinite(poses).all()
    assert (scores == value).all()


def test_the_same_seed_gives_the_same_particles():
    first, second, other = (search(peak, starts(8), seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])
    assert (first[0] != other[0]).any()


def test_poses_stay_rigid():
    poses, _ = search(peak, starts(8))
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_matrix()
    np.testing.assert_allclose(poses[:, :3, :3], turns, atol=1e-9)
