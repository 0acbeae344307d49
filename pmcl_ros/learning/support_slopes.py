"""Numbers of right poses, and of objects that are elsewhere -> what takes the place of support."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from scipy.special import expit

from pmcl_ros.runtime.errors import LocalizationError

_RIDGE = 1e-4  # of the logistic regression: few wrong poses have much support
_LEAST_ODDS = 0.01  # nat for a standard deviation of support: with less, slopes are noise
# Where the objective hardly falls any more, slopes still move: so the gradient decides.
_END = {'ftol': 0.0, 'gtol': 1e-9}


def support_slopes(right: ArrayLike, elsewhere: ArrayLike) -> NDArray[np.float64]:
    """(k,) by how much less support is enough for a unit of each other number; none is negative.

    right, elsewhere: (n, 1 + k) and (m, 1 + k) support and the other numbers of right poses, and
    of poses found for objects that are not there. Of the odds that a pose is right, by logistic
    regression, both kinds weighted alike. Raises LocalizationError where there are none of a kind,
    and where support does not tell them apart.
    """
    groups = [np.asarray(each, float) for each in (right, elsewhere)]
    counts = [len(each) for each in groups]
    if not all(counts):
        raise LocalizationError(f'{counts[0]} right poses and {counts[1]} poses found for objects '
                                'that are elsewhere: both are needed; learn from more scenes')
    given = np.concatenate(groups)
    scale = np.where(np.ptp(given, axis=0) > 0, given.std(axis=0), 1.0)
    given = np.column_stack([(given - given.mean(axis=0)) / scale, np.ones(len(given))])
    sign = np.repeat([1.0, -1.0], counts)
    weight = np.repeat([0.5 / each for each in counts], counts)
    ridge = np.append(np.full(len(scale), _RIDGE), 0.0)  # the intercept depends on the origin

    def unlikely(odds: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """And its gradient."""
        said = sign * (given @ odds)
        return (float(weight @ np.logaddexp(0, -said) + ridge @ odds ** 2),
                2 * ridge * odds - (weight * sign * expit(-said)) @ given)

    others = len(scale) - 1
    odds = minimize(unlikely, [1.0, *np.zeros(others + 1)], jac=True, options=_END, bounds=[
        (_LEAST_ODDS, None), *[(0, None)] * others, (None, None)]).x[:-1]
    if odds[0] <= _LEAST_ODDS:
        raise LocalizationError(f'{counts[0]} right poses have no more support than {counts[1]} '
                                'that are wrong; learn from more scenes')
    odds /= scale
    return np.asarray(odds[1:] / odds[0])
