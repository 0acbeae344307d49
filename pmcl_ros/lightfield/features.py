"""Features of posed views (SIFT), and matches between two views."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView

MATCHED = 0.5  # px: noise of a match
FEWEST = 12  # matches of a pair of views, twice what its relative pose has unknowns
_FEATURES = 1500  # of a picture
_LARGEST = 1280  # px, the longer side: SIFT holds eleven pictures of twice the size
_RATIO = 0.8  # of the distances to the nearest and the next feature (Lowe 2004, section 7.1)


class Features(NamedTuple):
    """What SIFT finds in a picture of at most `_LARGEST`.

    rays: (n, 3) with z = 1. descriptors: (n, 128). focal: length of the camera [px].
    """

    rays: NDArray[np.float64]
    descriptors: NDArray[np.float32]
    focal: float


def features_of(view: PosedView) -> Features:
    """Those of a view's picture, at most `_FEATURES`, none where its mask is False."""
    grey, pinhole = _reduced(view)
    # What moves with the camera matches as if the camera were at rest.
    mask = None if view.mask is None else cv2.resize(
        view.mask.astype(np.uint8), (pinhole.width, pinhole.height),
        interpolation=cv2.INTER_NEAREST)
    points, descriptors = cv2.SIFT.create(_FEATURES).detectAndCompute(grey, mask)
    if descriptors is None:
        return Features(np.zeros((0, 3)), np.zeros((0, 128), np.float32), pinhole.fx)
    rays = pinhole.rays(np.array([each.pt for each in points]))
    return Features(rays, np.asarray(descriptors, np.float32), pinhole.fx)


def match_features(first: Features, second: Features) -> NDArray[np.float64]:
    """(m, 2, 3) rays of features that are each other's nearest, by far."""
    if min(len(first.rays), len(second.rays)) < 2:
        return np.zeros((0, 2, 3))
    one, other = first.descriptors, second.descriptors
    # Exact, in any order: SIFT's are whole numbers, and all sums are less than 2^24.
    squares = (np.square(one).sum(axis=1)[:, None] + np.square(other).sum(axis=1)
               - 2 * one @ other.T)
    there, back = _nearest_by_far(squares), _nearest_by_far(squares.T)
    matched = np.flatnonzero(there >= 0)
    matched = matched[back[there[matched]] == matched]
    return np.stack([first.rays[matched], second.rays[there[matched]]], axis=1)


def _nearest_by_far(squares: NDArray[np.float32]) -> NDArray[np.int64]:
    """(n,) column of the least in each row of squared distances (n, m), -1: another is as near."""
    rows, nearest = np.arange(len(squares)), squares.argmin(axis=1)
    others = squares.copy()
    others[rows, nearest] = np.inf
    return np.where(squares[rows, nearest] < _RATIO ** 2 * others.min(axis=1), nearest, -1)


def essential_inliers(rays: NDArray[np.float64], focal: float) -> NDArray[np.float64]:
    """Those matches (m, 2, 3) that one relative pose explains; all, where they are too few."""
    if len(rays) < FEWEST:
        return rays
    cv2.setRNGSeed(0)
    _, inside = cv2.findEssentialMat(rays[:, 0, :2], rays[:, 1, :2], np.eye(3), cv2.RANSAC,
                                     0.999, 3 * MATCHED / focal)
    return rays[:0] if inside is None else rays[inside.ravel() > 0]


def _reduced(view: PosedView) -> tuple[NDArray[np.uint8], Pinhole]:
    """The grey picture, of at most `_LARGEST`, and its camera."""
    grey = np.round(255 * view.picture.mean(axis=2)).astype(np.uint8)
    share = min(_LARGEST / max(grey.shape), 1.0)
    pinhole = view.pinhole.resized(round(share * grey.shape[1]), round(share * grey.shape[0]))
    if share < 1:
        grey = np.asarray(cv2.resize(grey, (pinhole.width, pinhole.height),
                                     interpolation=cv2.INTER_AREA), np.uint8)
    return grey, pinhole
