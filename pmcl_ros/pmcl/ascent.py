"""From a pose uphill, by Gauss-Newton steps on local models of the evidence."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.local_model import LocalModel


def ascent(pose: NDArray[np.float64], about: Callable[[NDArray[np.float64]], LocalModel],
           steps: int, converged: float,
           allowed: Callable[[NDArray[np.float64]], bool] = lambda _: True
           ) -> tuple[NDArray[np.float64], LocalModel]:
    """The best pose reached from `pose` (4, 4) in so many steps, and the model there.

    about: the local model about a pose. converged: shorter steps are none [px, rms along the
    contour]. allowed: whether a pose may be gone to.
    """
    best, local = pose, about(pose)
    for _ in range(steps):
        step = local.step
        if local.motion(step) < converged:
            break
        for part in (1.0, 0.5, 0.25):
            tried = retract(best, part * step[None])[0]
            if not allowed(tried):
                continue
            there = about(tried)
            if there.evidence > local.evidence:
                best, local = tried, there
                break
        else:
            break
    return best, local
