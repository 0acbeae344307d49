"""Which candidate each object takes, or none: the best sum of what each and each pair says."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import LocalizationError

MOST_CHOICES = 4_000_000  # that are all looked at


def best_choice(own: Sequence[NDArray[np.float64]],
                pairs: Mapping[tuple[int, int], NDArray[np.float64]]) -> list[int | None]:
    """For each object the number of its candidate, or None; no other choice has a greater sum.

    own: for each object what its candidates (k,) are worth; none is worth 0; -inf: not that one.
    pairs: for objects i < j what each two of their candidates (k_i, k_j) are worth beside that;
        -inf: not both. Absent: 0.
    All choices are looked at. Raises LocalizationError where they are too many.
    """
    sizes = [len(each) + 1 for each in own]
    if np.prod(sizes, dtype=float) > MOST_CHOICES:
        raise LocalizationError(f'{len(own)} objects of {[size - 1 for size in sizes]} candidates '
                                f'make more than {MOST_CHOICES} choices: list fewer objects')
    total = np.zeros(sizes)
    for i, each in enumerate(own):
        total = total + _along(np.append(0.0, each), (i,), len(sizes))
    for (i, j), each in pairs.items():
        total = total + _along(np.pad(each, ((1, 0), (1, 0))), (i, j), len(sizes))
    chosen = np.unravel_index(int(total.argmax()), sizes)
    return [None if k == 0 else int(k) - 1 for k in chosen]


def most_candidates(objects: int) -> int:
    """How many candidates each of so many objects may have."""
    return max(int(MOST_CHOICES ** (1 / objects) + 1e-9) - 1, 1)


def _along(values: NDArray[np.float64], axes: tuple[int, ...], count: int) -> NDArray[np.float64]:
    """Values with their axes at `axes` of `count`, the others of length 1."""
    return np.expand_dims(values, tuple(k for k in range(count) if k not in axes))
