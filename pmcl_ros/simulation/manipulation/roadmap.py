"""A path between two postures by two random trees that grow towards each other.

RRT-Connect: Kuffner and LaValle, ICRA 2000.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_REACH = 0.3  # rad: of one branch
_AROUND = 1.5  # rad: beyond start and goal that is searched
_BRANCHES = 1500  # at most, of both trees together
_SHORTCUTS = 60  # that are tried


def connect(start: Array, goal: Array, limits: Array, is_free: Callable[[Array, Array], bool],
            rng: np.random.Generator) -> Array | None:
    """(n, 7) corners of a path, or None where none was found.

    limits: (7, 2) of the joints [rad]. is_free: whether the straight way from one posture to
    another touches nothing.
    """
    low = np.maximum(np.minimum(start, goal) - _AROUND, limits[:, 0])
    high = np.minimum(np.maximum(start, goal) + _AROUND, limits[:, 1])
    trees = _Tree(start), _Tree(goal)
    for turn in range(_BRANCHES):
        growing, other = trees[turn % 2], trees[1 - turn % 2]
        reached = growing.grow(rng.uniform(low, high), is_free)
        if reached is None:
            continue
        # The other tree grows towards the new branch until it is stopped.
        towards = growing.postures[reached]
        while (end := other.grow(towards, is_free)) is not None:
            if np.array_equal(other.postures[end], towards):
                first, last = (reached, end) if turn % 2 == 0 else (end, reached)
                corners = np.array(trees[0].branch(first)[::-1] + trees[1].branch(last)[1:])
                return _shortened(corners, is_free, rng)
    return None


class _Tree:
    def __init__(self, root: Array) -> None:
        self.postures, self._parents = [root], [-1]

    def grow(self, towards: Array, is_free: Callable[[Array, Array], bool]) -> int | None:
        """The number of a new posture, nearer to a given one; None where something is between."""
        away = towards - np.array(self.postures)
        parent = int(abs(away).max(axis=1).argmin())
        step = away[parent]
        far = float(abs(step).max())
        near = self.postures[parent]
        posture = towards if far <= _REACH else near + step * _REACH / far
        if not is_free(near, posture):
            return None
        self.postures.append(posture)
        self._parents.append(parent)
        return len(self.postures) - 1

    def branch(self, number: int) -> list[Array]:
        """Postures from a numbered one to the root."""
        found = []
        while number >= 0:
            found.append(self.postures[number])
            number = self._parents[number]
        return found


def _shortened(corners: Array, is_free: Callable[[Array, Array], bool],
               rng: np.random.Generator) -> Array:
    """With straight ways between points of it, where these are free."""
    for _ in range(_SHORTCUTS):
        if len(corners) < 3:
            break
        lengths = abs(np.diff(corners, axis=0)).max(axis=1)
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        cuts = np.sort(rng.uniform(0, at[-1], 2))
        first, last = np.searchsorted(at, cuts)
        ends = np.stack([np.interp(cuts, at, joint) for joint in corners.T], axis=1)
        if last > first and is_free(ends[0], ends[1]):
            corners = np.concatenate([corners[:first], ends, corners[last:]])
    return corners
