"""The depth likelihood of a ray from its distances to others (paper, section IV.A)."""

import numpy as np
from numpy.typing import NDArray


def depth_likelihood(distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., depths) L(i, j, d): for each stereo pair how far the depth is from the worst one.

    distances: (..., pairs, depths), the squared distance of the ray to the one found at each depth
    in each pair's other view. Divided, as the equation says, by the sum over all the depths; the
    values printed in the paper's proof leave the invalid depth out of it and are twice as large
    (`lemma.printed`). A pair in which all rays are alike tells nothing and adds 0.
    """
    worst = distances.max(axis=-1, keepdims=True)
    total = distances.sum(axis=-1, keepdims=True)
    share = np.divide(worst - distances, total, out=np.zeros_like(distances), where=total > 0)
    return np.asarray(share.sum(axis=-2))
