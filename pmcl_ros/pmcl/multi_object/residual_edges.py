"""An edge volume without the edges that objects account for, to look for more in it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.pmcl.render.contour_points import ContourPoints

_WIDTH = 2.5  # px: of what goes on both sides of a contour, a standard deviation


def unexplained(edges: EdgeVolume, contours: Sequence[ContourPoints]) -> EdgeVolume:
    """The edge volume with its energy taken away along contours, at all depths.

    Depth is told by edges' places in the views alone, so that an edge has energy at most labels.
    """
    height, width = edges.tensor.shape[:2]
    off = np.ones((height, width), bool)
    for each in contours:
        column, row = np.rint(each.pixels.T).astype(int)
        off[row.clip(0, height - 1), column.clip(0, width - 1)] = False
    away: NDArray[np.float64] = distance_transform_edt(off) if not off.all() else np.full(
        off.shape, np.inf)
    kept = (1 - np.exp(-0.5 * (away / _WIDTH) ** 2)).astype(np.float32)
    # The tensor is of squares.
    return replace(edges, tensor=edges.tensor * (kept ** 2)[..., None, None])
