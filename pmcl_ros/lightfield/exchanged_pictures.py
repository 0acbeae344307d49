"""PosedViews -> which pictures have the poses of others, by what they show around the object.

Two were exchanged, or all are shifted by one against the list of poses, the last to the first.
Where two views see an object, such pictures can show it too, at a wrong place: rays of two cameras
at one height meet somewhere.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.camera_adjustment import NEXT, PairFit, pair_fits
from pmcl_ros.lightfield.features import MATCHED, features_of
from pmcl_ros.lightfield.posed_view import PosedViews

_ODDS = 1000.0  # to one that pictures are in the order of the poses
_SEEN = 5  # of the six unknowns of a relative pose: matches do not see its scale
_GOOD = 0.25  # of what `PairFit` allows: a standard deviation of a good arm's poses


def right_order(pictures: PosedViews) -> tuple[int, ...] | None:
    """Of each picture the number of the view with whose pose it fits the surroundings.

    Two are exchanged, or all are shifted by one. None where they fit almost as well as they are,
    where nothing fits, and where too few features match.
    """
    views = pictures.views
    given = np.array([each.camera_to_reference for each in views])
    tried = _orders(len(views))
    cameras = [given, *(given[[*order]] for order in tried)]
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


def _orders(number: int) -> list[tuple[int, ...]]:
    """Those that are tried: two near each other exchanged, all shifted by one either way."""
    plain = [*range(number)]
    orders = [(*plain[:one], other, *plain[one + 1:other], one, *plain[other + 1:])
              for one, other in combinations(plain, 2) if other - one <= NEXT]
    if number > 2:  # of two views it is an exchange
        orders += [(number - 1, *plain[:-1]), (*plain[1:], 0)]
    return orders


def _log_likelihoods(pairs: Sequence[PairFit]) -> NDArray[np.float64]:
    """(n,) of the cameras that pairs were fitted to, whose poses have errors of unknown size.

    The most likely size counts: from the noise of matches to the largest that is expected.
    """
    squares = np.square([each.distances for each in pairs]).mean(axis=0)
    largest = max(float(np.mean([each.allowed for each in pairs])) / 2, MATCHED)
    variances = np.clip(squares, MATCHED ** 2, largest ** 2)
    return np.asarray(-_SEEN * len(pairs) / 2 * (np.log(variances) + squares / variances))
