"""Camera poses that fit what the pictures show of the surroundings, by matches of features.

A structureless bundle adjustment: matches must lie on each other's epipolar lines. It sees how
cameras stand to each other but for the scale; what it does not see stays as reported.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from pmcl_ros.geometry.epipolar import parallax, sampson
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.lightfield.features import (
    FEWEST,
    MATCHED,
    Features,
    essential_inliers,
    match_features,
)
from pmcl_ros.lightfield.posed_view import PosedView

_PRIOR = 0.002, 0.007  # m, rad: how far reported poses are off, of each axis: two of a good arm's
_UNLIKELY = 0.01  # probability that they are farther off: matches of a pattern that repeats
_FLOOR = 0.0002, 0.0003  # m, rad: what stays unknown: lenses are known to a fraction of a pixel
_GATE = 4.0  # standard deviations of reported poses that a match may be off its line
_BEHIND = 2.0  # the same, by which reported rotations may put what is far away behind the cameras
_MOST = 150  # matches of a pair of views
_CAUCHY, _GEMAN_MCCLURE = 12, 8  # iterations of reweighted least squares with their tails
_STEP = 1e-3  # standard deviations of reported poses, of derivatives
NEXT = 4  # views before and after each in the list, of which one is chosen to judge any poses
_NEIGHBOURS = 3  # views that each view is matched with
_DISTANCE = 0.5  # m: of what is seen, for the gate


@dataclass(frozen=True)
class CameraAdjustment:
    """Poses of cameras that fit the surroundings.

    cameras: (n, 4, 4) camera to reference. root: (n, 6, k) what they may still be off, as
    `CameraErrors.root`. before, after: median distance of matches from their epipolar lines with
    the reported and these poses [px], in the pictures of the features. off: largest motion of a
    camera [m], [rad].
    """

    cameras: NDArray[np.float64]
    root: NDArray[np.float64]
    before: float
    after: float
    off: tuple[float, float]

    @property
    def is_needed(self) -> bool:
        """Whether the reported poses do not fit what the pictures show."""
        return self.before > MATCHED


@dataclass(frozen=True)
class PairFit:
    """How far matches of two pictures are from their epipolar lines, half of them at least.

    views: their numbers. distances: by each of some cameras [px]. allowed: what is possible where
    reported poses are off by their errors, twice `_PRIOR` and the stated ones [px].
    """

    views: tuple[int, int]
    distances: tuple[float, ...]
    allowed: float

    @property
    def excess(self) -> float:
        """The distance by the first cameras, as a share of what is possible."""
        return self.distances[0] / self.allowed


def pair_fits(views: Sequence[PosedView], features: Sequence[Features],
              cameras: Sequence[NDArray[np.float64]]) -> list[PairFit]:
    """How the matches of pairs of views fit cameras, each (n, 4, 4), whatever these are.

    A pair is a view and the one that it has most matches with, of the `NEXT` before and after
    it: the very next may show something else where pictures were exchanged. Matches are those that
    one relative pose explains. Where these are less than half, as in a pattern that repeats, or
    fewer than `FEWEST`, the pair is left out.
    """
    position, rotation = np.max([_PRIOR, *(each.sigma for each in views)], axis=0)
    found = []
    for (one, other), matched in _best_matched(features).items():
        length = (features[one].focal + features[other].focal) / 2
        rays = essential_inliers(matched, length)
        if len(rays) >= max(FEWEST, len(matched) / 2):
            found.append(PairFit((one, other), tuple(float(np.median(np.abs(
                length * sampson(rays, (np.linalg.inv(each[other]) @ each[one])[None]))))
                for each in cameras),
                2 * length * np.sqrt(2) * np.hypot(position / _DISTANCE, rotation)))
    return found


def adjust_cameras(views: Sequence[PosedView], features: Sequence[Features]
                   ) -> CameraAdjustment | None:
    """The poses that fit matches between the pictures, by the features of each.

    None where too few match, or no likely poses fit most pairs within `MATCHED`. Reported poses
    are taken to be off by `_PRIOR` on each axis, each by itself; a match to be off its line by
    `MATCHED`, with heavy tails. A pattern that repeats can match wrongly in all of a pair of
    views: motions are fitted without such pairs, one after the other, until they are likely and
    all other pairs fit them.
    """
    reported = np.array([each.camera_to_reference for each in views])
    matches = _Matches.between(features, reported)
    most, fewest = chdtri(6 * (len(views) - 1), _UNLIKELY), len(matches.views) / 2
    while len(matches.views) >= max(fewest, 1):
        fit = _Fit.of(matches, reported)
        distances = matches.median_distances(_moved(reported, fit.unit))
        if fit.unit @ fit.unit > most:
            matches = matches.without(fit.unlikely_pair())
        elif distances.max() > MATCHED:
            matches = matches.without(int(np.argmax(distances)))
        else:
            return _adjustment(fit, matches, reported)
    return None


def _adjustment(fit: '_Fit', matches: '_Matches', reported: NDArray[np.float64]
                ) -> CameraAdjustment:
    number, sigma = len(reported), _sigma(len(reported))
    cameras = _moved(reported, fit.unit)
    before, after = (float(np.median(np.abs(matches.distances(each))))
                     for each in (reported, cameras))
    covariance = sigma[:, None] * fit.covariance * sigma + np.diag(
        np.square(np.tile(np.repeat(_FLOOR, 3), number)))
    motions = (sigma * fit.unit).reshape(-1, 2, 3)
    largest = np.linalg.norm(motions, axis=2).max(axis=0)
    root = np.asarray(np.linalg.cholesky(covariance), float).reshape(number, 6, -1)
    return CameraAdjustment(cameras, root, before, after, (float(largest[0]), float(largest[1])))


def _sigma(number: int) -> NDArray[np.float64]:
    """(6 number,) standard deviations of reported poses."""
    return np.tile(np.repeat(_PRIOR, 3), number)


def _moved(reported: NDArray[np.float64], unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cameras (n, 4, 4) that are off by unit (6 n,), in standard deviations."""
    off = retract(np.tile(np.eye(4), (len(reported), 1, 1)),
                  (_sigma(len(reported)) * unit).reshape(-1, 6))
    return np.asarray(reported @ np.linalg.inv(off))


@dataclass(frozen=True)
class _Matches:
    """Matches between pictures.

    views: (p, 2) numbers of the views of pairs. pair: (m,) that of each match, ascending. rays:
    (m, 2, 3) in either camera, with z = 1. focal: (m,) mean focal length [px].
    """

    views: NDArray[np.intp]
    pair: NDArray[np.intp]
    rays: NDArray[np.float64]
    focal: NDArray[np.float64]

    @classmethod
    def between(cls, features: Sequence[Features], reported: NDArray[np.float64]) -> '_Matches':
        """Of pairs with at least `FEWEST`."""
        views: list[tuple[int, int]] = []
        rays: list[NDArray[np.float64]] = [np.zeros((0, 2, 3))]
        focal: list[float] = []
        for one, other in _neighbours(reported):
            length = (features[one].focal + features[other].focal) / 2
            matched = _consistent(match_features(features[one], features[other]), length,
                                  reported[[one, other]])
            if len(matched) >= FEWEST:
                views.append((one, other))
                rays.append(matched)
                focal.append(length)
        pair = np.repeat(np.arange(len(views)), [len(each) for each in rays[1:]])
        return cls(np.array(views, np.intp).reshape(-1, 2), pair, np.concatenate(rays),
                   np.array(focal)[pair])

    def without(self, pair: int) -> '_Matches':
        """Those of the other pairs."""
        kept = self.pair != pair
        return _Matches(np.delete(self.views, pair, axis=0),
                        self.pair[kept] - (self.pair[kept] > pair), self.rays[kept],
                        self.focal[kept])

    def distances(self, cameras: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m,) signed Sampson distances of the matches with cameras (n, 4, 4) [px]."""
        return self._distances(cameras, cameras)

    def median_distances(self, cameras: NDArray[np.float64]) -> NDArray[np.float64]:
        """(p,) of the matches of each pair, with cameras (n, 4, 4) [px]."""
        distances = np.abs(self.distances(cameras))
        return np.array([np.median(distances[self.pair == pair])
                         for pair in range(len(self.views))])

    def slopes(self, reported: NDArray[np.float64], unit: NDArray[np.float64]
               ) -> NDArray[np.float64]:
        """(m, 12) derivatives of the distances by `unit` of the first, then the second camera."""
        cameras, found = _moved(reported, unit), []
        distances = self.distances(cameras)
        for axis in np.eye(6):
            moved = _moved(reported, unit + _STEP * np.tile(axis, len(reported)))
            found += [self._distances(moved, cameras), self._distances(cameras, moved)]
        slopes = (np.stack(found, axis=1) - distances[:, None]) / _STEP
        return slopes.reshape(-1, 6, 2).swapaxes(1, 2).reshape(-1, 12)

    def _distances(self, first: NDArray[np.float64], second: NDArray[np.float64]
                   ) -> NDArray[np.float64]:
        one, other = self.views[self.pair].T
        return self.focal * sampson(self.rays, np.linalg.inv(second)[other] @ first[one])


@dataclass(frozen=True)
class _Fit:
    """Motions that fit matches best.

    unit: (6 n,) in standard deviations of reported poses. covariance: (6 n, 6 n) of it. rows:
    (p, 12) those of the two views of each pair. pairs: (p, 12, 12) its information on them.
    pulls: (p, 12) and how it pulls them.
    """

    unit: NDArray[np.float64]
    covariance: NDArray[np.float64]
    rows: NDArray[np.intp]
    pairs: NDArray[np.float64]
    pulls: NDArray[np.float64]

    @classmethod
    def of(cls, matches: _Matches, reported: NDArray[np.float64]) -> '_Fit':
        """By reweighted least squares.

        Cauchy's tails bring what is far off nearer; those of Geman and McClure then leave out what
        stays far off.
        """
        starts = np.searchsorted(matches.pair, np.arange(len(matches.views)))
        rows = (6 * matches.views[:, :, None] + np.arange(6)).reshape(-1, 12)
        unit = np.zeros(6 * len(reported))
        for power in (1,) * _CAUCHY + (2,) * _GEMAN_MCCLURE:
            off = matches.distances(_moved(reported, unit)) / MATCHED
            slopes = matches.slopes(reported, unit) / MATCHED
            weighted = slopes / (1 + np.square(off))[:, None] ** power
            pairs = np.add.reduceat(weighted[:, :, None] * slopes[:, None], starts)
            pulls = np.add.reduceat(weighted * off[:, None], starts)
            information, gradient = np.eye(len(unit)), unit.copy()
            np.add.at(information, (rows[:, :, None], rows[:, None]), pairs)
            np.add.at(gradient, rows, pulls)
            covariance = np.asarray(np.linalg.inv(information), float)
            unit = unit - covariance @ gradient
        return cls(unit, covariance, rows, pairs, pulls)

    def unlikely_pair(self) -> int:
        """The pair without which motions are most likely, to first order."""
        # Woodbury's identity takes a pair from the information.
        own = self.covariance[self.rows[:, :, None], self.rows[:, None]]
        removed = np.linalg.solve(np.eye(12) - self.pairs @ own, self.pulls[:, :, None])
        without = self.unit + np.einsum('ipj,pj->pi', self.covariance[:, self.rows],
                                        removed[:, :, 0])
        return int(np.argmin(np.square(without).sum(axis=1)))


def _best_matched(features: Sequence[Features]) -> dict[tuple[int, int], NDArray[np.float64]]:
    """Matches (m, 2, 3) of pairs of views: each view with the one that shows most of the same."""
    views = range(len(features))
    matched = {(one, other): match_features(features[one], features[other])
               for one, other in combinations(views, 2) if other - one <= NEXT}
    best = {max((pair for pair in matched if view in pair), key=lambda pair: len(matched[pair]))
            for view in views if matched}
    return {pair: matched[pair] for pair in sorted(best)}


def _neighbours(reported: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pairs of views: each with those whose axes are nearest to its own."""
    near = np.argsort(-(reported[:, :3, 2] @ reported[:, :3, 2].T), axis=1)[:, :_NEIGHBOURS + 1]
    return [(one, other) for one, other in combinations(range(len(reported)), 2)
            if other in near[one] or one in near[other]]


def _consistent(rays: NDArray[np.float64], focal: float, reported: NDArray[np.float64]
                ) -> NDArray[np.float64]:
    """Those matches (m, 2, 3) that one relative pose explains, and is about the reported one.

    By the reported pose they are not behind the cameras, as those of a pattern that repeats can
    be.
    """
    position, rotation = _PRIOR
    gate = _GATE * np.sqrt(2) * np.hypot(position / _DISTANCE, rotation)
    relative = np.linalg.inv(reported[1]) @ reported[0]
    between = np.tile(relative, (len(rays), 1, 1))
    rays = rays[(np.abs(sampson(rays, between)) < gate)
                & (parallax(rays, relative) > -_BEHIND * np.sqrt(2) * rotation)]
    rays = essential_inliers(rays, focal)
    return rays[::max(-(-len(rays) // _MOST), 1)]
