"""Whether the pictures of a calibration are of one zoom and focus, or of two.

Each picture gets a focal length of its own. Where these differ by more than chance, and fall into
two groups, the zoom or the focus was moved.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import fdtrc

from pmcl_ros.geometry.sheet_pose import sheet_pose

_UNLIKELY = 1e-4  # chance that focal lengths of one zoom differ so much
_APART = 4.0  # of two groups, in spreads within them; halves of one spread are 2.7 apart
_LEAST_SPREAD = 0.01  # of boards that are not flat, and lenses that are not quite of the model
_SHARED = 8  # unknowns that all pictures have in common: fy / fx, cx, cy, k1, k2, p1, p2, k3
_OF_LENS = slice(6, 15)  # columns of fx, fy, cx, cy, k1, k2, p1, p2, k3 in OpenCV's derivatives


@dataclass(frozen=True)
class TwoZooms:
    """names: of the pictures of each zoom; focal: fx of each [px], the shorter first."""

    names: tuple[tuple[str, ...], tuple[str, ...]]
    focal: tuple[float, float]


def two_zooms(pictures: Mapping[str, NDArray[np.float64]], board: NDArray[np.float64],
              camera: NDArray[np.float64]) -> TwoZooms | None:
    """The two zooms that pictures are of; None where they may well be of one.

    pictures: three or more, by name, (m, 2) corners of a board [px], NaN: not seen. board: (m, 3)
    its corners [m]; z is small. camera: (8,) fx, fy, cx, cy [px], k1, k2, p1, p2, of the one that
    fits all best.
    """
    shown = [np.isfinite(each).all(axis=1) for each in pictures.values()]
    views = [_View.seen(board[own], corners[own], camera)
             for own, corners in zip(shown, pictures.values(), strict=True)]
    logs, information = _own_focal_lengths(views, camera)
    free = sum(each.corners.size for each in views) - 7 * len(views) - _SHARED
    off = logs - information.sum(axis=0) @ logs / information.sum()
    if fdtrc(len(off) - 1, free, off @ information @ off / (len(off) - 1)) > _UNLIKELY:
        return None
    is_longer, (low, high), spread = _halved(logs, 1 / np.diag(np.linalg.inv(information)))
    if high - low < _APART * np.hypot(spread, _LEAST_SPREAD):
        return None
    names = np.array([*pictures])
    return TwoZooms((tuple(names[~is_longer].tolist()), tuple(names[is_longer].tolist())),
                    (float(np.exp(low)), float(np.exp(high))))


@dataclass(frozen=True)
class _View:
    """points (m, 3) [m] and corners (m, 2) [px] of a picture; about its pose, as OpenCV's."""

    points: NDArray[np.float64]
    corners: NDArray[np.float64]
    turn: NDArray[np.float64]
    place: NDArray[np.float64]

    @classmethod
    def seen(cls, points: NDArray[np.float64], corners: NDArray[np.float64],
             camera: NDArray[np.float64]) -> '_View':
        fx, fy, cx, cy = camera[:4]
        turn, place = sheet_pose(points, corners, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
                                 camera[4:])
        return cls(points, corners, turn, place)

    def fitted(self, shared: NDArray[np.float64], log: float
               ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Residuals (2 m,) [px] at the pose that fits best; their derivatives (2 m, 8 + 1) by the
        shared unknowns and the logarithm of fx, and by the pose (2 m, 6).
        """
        focal, ratio = np.exp(log), shared[0]
        matrix = np.array([[focal, 0, shared[1]], [0, ratio * focal, shared[2]], [0, 0, 1]])
        pose = cv2.solvePnPRefineLM(self.points, self.corners, matrix, shared[3:],
                                    self.turn[:, None].copy(), self.place[:, None].copy())
        expected, slopes = cv2.projectPoints(self.points, *pose, matrix, shared[3:])
        by_pose, lens = np.asarray(slopes[:, :6], float), np.asarray(slopes[:, _OF_LENS], float)
        by_fx, by_fy = lens[:, :1], lens[:, 1:2]
        own = np.hstack([focal * by_fy, lens[:, 2:], focal * (by_fx + ratio * by_fy)])
        return (expected[:, 0] - self.corners).ravel(), own, by_pose


def _own_focal_lengths(views: list[_View], camera: NDArray[np.float64]
                       ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n,) logarithms of fx [px] of each picture, and the inverse (n, n) of their covariance.

    With k3, which a lens of a wide angle may have: else it would pass for a zoom.
    """
    count = len(views)
    fx, fy, *others = camera
    values = np.array([fy / fx, *others, 0, *np.full(count, np.log(fx))])
    sigmas = np.ones(count)

    @lru_cache(1)  # the derivatives are asked for where the residuals just were
    def fits(packed: bytes) -> list[tuple[NDArray[np.float64], ...]]:
        shared, logs = np.split(np.frombuffer(packed).copy(), [_SHARED])
        return [each.fitted(shared, log) for each, log in zip(views, logs, strict=True)]

    def residuals(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([off / sigma for (off, _, _), sigma
                               in zip(fits(values.tobytes()), sigmas, strict=True)])

    def jacobian(values: NDArray[np.float64]) -> NDArray[np.float64]:
        rows = []
        for number, ((_, own, by_pose), sigma) in enumerate(zip(fits(values.tobytes()), sigmas,
                                                                strict=True)):
            # The pose follows.
            slopes = own - by_pose @ np.linalg.lstsq(by_pose, own, rcond=None)[0]
            rows.append(np.zeros((len(slopes), len(values))))
            rows[-1][:, :_SHARED] = slopes[:, :-1] / sigma
            rows[-1][:, _SHARED + number] = slopes[:, -1] / sigma
        return np.concatenate(rows)

    sizes = np.array([each.corners.size for each in views])
    share = 1 - (7 * count + _SHARED) / sizes.sum()
    for _ in range(2):  # then, with what they showed, a picture that is blurred counts less
        values = least_squares(residuals, values, jacobian, method='lm', x_scale='jac').x
        parts = np.split(sigmas.repeat(sizes) * residuals(values), np.cumsum(sizes)[:-1])
        squares = np.array([np.square(each).sum() for each in parts]) / share
        sigmas = np.sqrt(np.maximum(squares / sizes, squares.sum() / sizes.sum()))
    slopes = jacobian(values)
    covariance = np.linalg.pinv(slopes.T @ slopes, hermitian=True)[_SHARED:, _SHARED:]
    return values[_SHARED:], np.linalg.inv(covariance)


def _halved(values: NDArray[np.float64], weights: NDArray[np.float64]
            ) -> tuple[NDArray[np.bool_], NDArray[np.float64], float]:
    """Of the two groups that fit values (n,) best: which values are in the upper one, their means,
    and the spread within them.
    """
    best = np.zeros(len(values), bool), np.zeros(2), np.inf
    for least in np.unique(values)[1:]:
        upper = values >= least
        means = np.array([np.average(values[each], weights=weights[each])
                          for each in (~upper, upper)])
        within = np.average(np.square(values - means[upper.astype(int)]), weights=weights)
        if within < best[2]:
            best = upper, means, float(within)
    return best[0], best[1], float(np.sqrt(best[2] * len(values) / (len(values) - 2)))
