"""The default search: groups of particles, one around each proposal, annealed in a tournament."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.motion import perturb
from pmcl_ros.pmcl.weights import Weights

Score = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Progress = Callable[[float], bool]

# The evidence is a sum over pixels whose noise is alike over about this many [px]; a first guess,
# to be calibrated.
CORRELATION = 8.0
_EFFECTIVE = 0.3  # of the particles that tempering leaves effective
_FIRST, _LAST = 0.006, 0.0004  # m: how far particles move across the line of sight, first and last
# Along the line of sight, and turning towards or away from the camera, moves the contour least.
_ALONG = 3.0


def annealed_filter(coarse: Score, fine: Score, start: NDArray[np.float64], radius: float,
                    particles: int, moves: int, rng: np.random.Generator, progress: Progress
                    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses (n, 4, 4) of the last round and their scores (n,).

    They are samples of the posterior about its mode, scored by `fine`, unless `progress` ended the
    search early.
    start: (k, 4, 4) proposals. Each gets an equal share of the particles, which compete among
        themselves alone, so that a good start badly aligned is not lost to a bad one well aligned.
        After `moves` moves the better half of the groups goes on with twice the particles each,
        until one is left; moves shrink geometrically. The coarse score decides first, the fine one
        the second half of the rounds.
    radius: of the object [m].
    """
    groups = start[:, None]
    rounds = max(1, math.ceil(math.log2(len(start)))) + 1
    sigmas = np.geomspace(_FIRST, _LAST, rounds * moves).reshape(rounds, moves)
    scores = np.zeros(groups.shape[:2])
    for done, steps in enumerate(sigmas):
        score = coarse if done < rounds // 2 else fine
        size = max(2, particles // len(groups))
        groups = groups[:, np.arange(size) % groups.shape[1]]
        scores = _each(score, groups)
        for step, sigma in enumerate(steps):
            if not progress((done * moves + step) / sigmas.size):
                winner = int(scores.max(axis=1).argmax())
                return groups[winner], scores[winner]
            moved = perturb(groups.reshape(-1, 4, 4), sigma * np.array([1, 1, _ALONG]),
                            sigma / radius * np.array([_ALONG, _ALONG, 1]), rng)
            moved = moved.reshape(groups.shape)
            both = np.concatenate([groups, moved], axis=1)
            both_scores = np.concatenate([scores, _each(score, moved)], axis=1)
            kept = _select(both_scores, size, last=len(groups) == 1, rng=rng)
            groups = np.take_along_axis(both, kept[..., None, None], axis=1)
            scores = np.take_along_axis(both_scores, kept, axis=1)
        if len(groups) > 1:
            order = np.argsort(-scores.max(axis=1), kind='stable')
            better = order[:(len(groups) + 1) // 2]
            groups, scores = groups[better], scores[better]
    return groups[0], scores[0]


def _select(scores: NDArray[np.float64], size: int, *, last: bool, rng: np.random.Generator
            ) -> NDArray[np.int64]:
    """(groups, size) who survives: the best of each; of the last group, a draw by its weights."""
    if not last:
        return np.argsort(-scores, axis=1, kind='stable')[:, :size]
    return Weights.tempered(scores[0], 1 / CORRELATION, _EFFECTIVE).resample(size, rng)[None]


def _each(score: Score, groups: NDArray[np.float64]) -> NDArray[np.float64]:
    return score(groups.reshape(-1, 4, 4)).reshape(groups.shape[:2])
