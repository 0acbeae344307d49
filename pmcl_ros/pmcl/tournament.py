"""The search among proposals: groups of particles, annealed in a tournament."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.history import Record
from pmcl_ros.pmcl.motion import perturb

Score = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Progress = Callable[[float], bool]

# Along the line of sight, and turning towards or away from the camera, moves the contour least.
_ALONG = 3.0


def tournament(score: Score, start: NDArray[np.float64], survivors: int, radius: float,
               particles: int, moves: int, steps: tuple[float, float], rng: np.random.Generator,
               progress: Progress, record: Record | None = None
               ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The best pose of each surviving group, (n, 4, 4) and (n,) scores, best first.

    start: (k, 4, 4). Each gets an equal share of the particles, which compete among themselves
        alone, so that a good start badly aligned is not lost to a bad one well aligned. After
        `moves` moves the better half of the groups goes on with twice the particles each, until
        `survivors` (or fewer) are left.
    steps: across the line of sight, how far particles move first and last [m]; shrinks
        geometrically. All groups draw the same moves, so that luck does not decide between them.
    radius: of the object [m]. record: told the groups after each move.
    Ends early, with what was found so far, when `progress` says so.
    """
    groups = start[:, None]
    rounds = _rounds(len(start), survivors)
    sigmas = np.geomspace(*steps, rounds * moves).reshape(rounds, moves)
    scores = score(start)[:, None]
    for done, each in enumerate(sigmas):
        size = max(2, particles // len(groups))
        groups = groups[:, np.arange(size) % groups.shape[1]]
        scores = scores[:, np.arange(size) % scores.shape[1]]
        for step, sigma in enumerate(each):
            if not progress((done * moves + step) / sigmas.size):
                return _best(groups, scores)
            moved = _moved(groups, sigma, radius, rng)
            both = np.concatenate([groups, moved], axis=1)
            both_scores = np.concatenate(
                [scores, score(moved.reshape(-1, 4, 4)).reshape(scores.shape)], axis=1)
            kept = np.argsort(-both_scores, axis=1, kind='stable')[:, :size]
            groups = np.take_along_axis(both, kept[..., None, None], axis=1)
            scores = np.take_along_axis(both_scores, kept, axis=1)
            if record is not None:
                record(groups, scores)
        order = np.argsort(-scores.max(axis=1), kind='stable')
        left = order[:max(min(survivors, len(order)), (len(order) + 1) // 2)]
        groups, scores = groups[left], scores[left]
    return _best(groups, scores)


def _rounds(groups: int, survivors: int) -> int:
    """At least one."""
    rounds = 1
    while (groups := (groups + 1) // 2) > survivors:
        rounds += 1
    return rounds


def _moved(groups: NDArray[np.float64], sigma: float, radius: float, rng: np.random.Generator
           ) -> NDArray[np.float64]:
    """Groups (k, n, 4, 4), their n-th particles all perturbed alike."""
    shift = sigma * np.array([1, 1, _ALONG])
    turn = sigma / radius * np.array([_ALONG, _ALONG, 1])
    motion = perturb(np.tile(np.eye(4), (groups.shape[1], 1, 1)), shift, turn, rng)
    moved = np.empty_like(groups)
    moved[..., :3, :3] = motion[:, :3, :3] @ groups[..., :3, :3]
    moved[..., :3, 3] = groups[..., :3, 3] + motion[:, :3, 3]
    moved[..., 3, :] = [0, 0, 0, 1]
    return moved


def _best(groups: NDArray[np.float64], scores: NDArray[np.float64]
          ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    best = scores.argmax(axis=1)
    each = np.arange(len(groups))
    order = np.argsort(-scores[each, best], kind='stable')
    return groups[each, best][order], scores[each, best][order]
