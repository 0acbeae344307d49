"""The directions for which the probability of a contour is defined, and their share of a label."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.learning.contour_net.pictures import BINS

HALF_WIDTH = np.pi / 8  # rad: a direction stands for the normals within this angle


def direction_targets(directions: NDArray[np.integer]) -> NDArray[np.float32]:
    """(33, n): the share of a label -1, 0, ..., 31 that lies within 22.5 degrees of a direction.

    directions: (n,) of 32. A label stands for angles of 11.25 degrees, so those at 22.5 degrees
    count half.
    """
    labels = np.arange(BINS)[:, None]
    apart = np.abs((labels - directions + BINS // 2) % BINS - BINS // 2)
    reach = round(HALF_WIDTH / (2 * np.pi / BINS))
    shares = np.where(apart < reach, 1.0, np.where(apart == reach, 0.5, 0.0))
    return np.concatenate([np.zeros((1, len(directions))), shares]).astype(np.float32)
