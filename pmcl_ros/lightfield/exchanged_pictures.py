"""PosedViews -> which two pictures were exchanged, by what they show around the object.

Where two views see an object, exchanged pictures can show it too, at a wrong place: rays of two
cameras at one height meet somewhere.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.camera_adjustment import NEXT, PairFit, pair_fits
from pmcl_ros.lightfield.features import MATCHED, features_of
from pmcl_ros.lightfield.posed_view import PosedViews

_ODDS = 1000.0  # to one that no two pictures were exchanged
_SEEN = 5  # of the six unknowns of a relative pose: matches do not see its scale
_GOOD = 0.25  # of what `PairFit` allows: a standard deviation of a good arm's poses


def exchanged_pictures(pictures: PosedViews) -> tuple[int, int] | None:
    """Numbers of the two views that fit the surroundings if their poses are exchanged.

    None where they fit almost as well as they are, where nothing fits, and where too few features
    match.
    """
    views = pictures.views
    given = np.array([each.camera_to_reference for each in views])
    tried = [pair for pair in combinations(range(len(views)), 2) if pair[1] - pair[0] <= NEXT]
    cameras = [given]
    for one, other in tried:
        exchanged = given.copy()
        exchanged[[one, other]] = given[[other, one]]
        cameras.append(exchanged)
    pairs = pair_fits(views, [features_of(each) for each in views], cameras)
    if not pairs:
        return None
    likely = _log_likelihoods(pairs)
    best = int(likely.argmax())
    if likely[best] - likely[0] <= np.log(_ODDS * len(tried)):
        return None
    # A pattern that repeats matches wrongly: it fits neither poses, nor others well.
    fits = all(each.distances[best] <= _GOOD * each.allowed for each in pairs)
    return tried[best - 1] if fits else None


def _log_likelihoods(pairs: Sequence[PairFit]) -> NDArray[np.float64]:
    """(n,) of the cameras that pairs were fitted to, whose poses have errors of unknown size.

    The most likely size counts: from the noise of matches to the largest that is expected.
    """
    squares = np.square([each.distances for each in pairs]).mean(axis=0)
    largest = max(float(np.mean([each.allowed for each in pairs])) / 2, MATCHED)
    variances = np.clip(squares, MATCHED ** 2, largest ** 2)
    return np.asarray(-_SEEN * len(pairs) / 2 * (np.log(variances) + squares / variances))
