"""Generations of poses of a search, for a callback that watches it."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Stage = Literal['proposals', 'coarse', 'fine', 'ambiguous', 'scattered', 'sharpened',
                'modes', 'approximate', 'posterior', 'filter']


@dataclass(frozen=True)
class Generation:
    """The particles at one moment of a search.

    stage: of the search. poses: (n, 4, 4), object to camera [m].
    scores: (n,) in the unit of the stage: template scores of the proposals; evidence [nat] of
        refined poses and modes; log posterior, up to a constant, in 'approximate' and
        'posterior'; the mean likelihood in 'filter'.
    time: of the generation, by `time.perf_counter` [s].
    """

    stage: Stage
    poses: NDArray[np.float64]
    scores: NDArray[np.float64]
    time: float = field(default_factory=time.perf_counter)


Watch = Callable[[Generation], None]
Record = Callable[[NDArray[np.float64], NDArray[np.float64]], None]


def recorder(watch: Watch | None, stage: Stage) -> Record | None:
    """A callback for the particles of a stage: poses (n, 4, 4) and scores (n,).

    None where nobody watches.
    """
    if watch is None:
        return None

    def record(poses: NDArray[np.float64], scores: NDArray[np.float64]) -> None:
        watch(Generation(stage, poses.copy(), scores.copy()))
    return record
