"""Which corners of a board agree on its pose: what is seen aside, as behind glass, does not."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.sheet_pose import sheet_pose
from pmcl_ros.runtime.errors import LightFieldError

_UNSUSPECTED = 0.03  # px, on each axis: what is less off is not suspected
_UNLIKELY = 0.01  # chance of right corners, one of which is so far off


def agreeing(points: NDArray[np.float64], corners: NDArray[np.float64], pinhole: Pinhole,
             least: int) -> NDArray[np.intp]:
    """(k,) numbers of the corners that are left without those that do not fit the others.

    points: (n, 3) on the board, of which z is small [m]. corners: (n, 2) without distortion [px];
    few are wrong. least: of corners, 5 or more; where fewer are left, these may be wrong too.
    """
    kept, still = np.arange(len(points)), np.zeros(4)
    while len(kept) >= least:
        there, seen = points[kept], corners[kept]
        try:
            pose = sheet_pose(there, seen, pinhole.matrix, still)
        except LightFieldError:
            return kept[:0]
        expected, slopes = cv2.projectPoints(there, *pose, pinhole.matrix, still)
        chances = _chances(seen - expected[:, 0], np.asarray(slopes[:, :6], float))
        worst = int(chances.argmin())
        if chances[worst] * len(kept) > _UNLIKELY:
            break
        kept = np.delete(kept, worst)
    return kept


def _chances(off: NDArray[np.float64], slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) chances of right corners to fit so much worse than the others, which are fitted alone.

    off: (n, 2) residuals of a fit to all [px]. slopes: (2 n, 6) derivatives of the corners by the
    pose. (Cook and Weisberg, "Residuals and Influence in Regression", 1982.)
    """
    count = len(off)
    each = np.arange(count)
    hat = (slopes @ np.linalg.pinv(slopes)).reshape(count, 2, count, 2)[each, :, each]
    free = np.linalg.pinv(np.eye(2) - hat, rcond=1e-6, hermitian=True)
    fewer = np.einsum('ni,nij,nj->n', off, free, off)  # squares, without the corner
    freedom = 2 * count - 8
    variance = np.maximum((np.square(off).sum() - fewer) / freedom, _UNSUSPECTED ** 2)
    return np.asarray(fdtrc(2, freedom, fewer / 2 / variance))
