"""How a search went, generation by generation. Nothing is kept unless somebody watches."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Stage = Literal['proposals', 'coarse', 'fine', 'ambiguous', 'scattered', 'modes',
                'approximate', 'posterior', 'filter']


@dataclass(frozen=True)
class Generation:
    """The particles at one moment of a search.

    stage: what the search was at. poses: (n, 4, 4), object to camera [m].
    scores: (n,) in the stage's own units: the templates' of the proposals; evidence [nat] of what
        climbed from them and of the modes; log posterior, but for a constant, in
        'approximate' and 'posterior'; the mean likelihood in 'filter'.
    time: when it was so, of `time.perf_counter` [s].
    """

    stage: Stage
    poses: NDArray[np.float64]
    scores: NDArray[np.float64]
    time: float = field(default_factory=time.perf_counter)


Watch = Callable[[Generation], None]
Record = Callable[[NDArray[np.float64], NDArray[np.float64]], None]


def recorder(watch: Watch | None, stage: Stage) -> Record | None:
    """What a stage tells its particles: poses (n, 4, 4), and scores (n,).

    None, as nobody watches, says that they need not be told.
    """
    if watch is None:
        return None

    def record(poses: NDArray[np.float64], scores: NDArray[np.float64]) -> None:
        watch(Generation(stage, poses.copy(), scores.copy()))
    return record
