"""Computes recalls, medians, lost rates and the coverage of credible regions over trials.

An object that is there and reported as lost counts as not found, wherever the best hypothesis
lies; medians are over all hypotheses.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.geometry.pose_error import RIGHT_BOUNDS

BOUNDS = (RIGHT_BOUNDS, (10.0, 10.0), (5.0, 5.0))  # mm, degrees
LADDER = tuple(range(2, 21, 2))  # mm: BOP's of 2024 for MSSD
_PARTS = np.arange(1, 11) / 20  # of the diameter: BOP's for MSSD
_PIXELS = np.arange(5, 51, 5)  # px in views 640 px wide: BOP's for MSPD


def values(trials: Sequence[Trial], name: str) -> NDArray[np.float64]:
    """(n,) a field of each trial, or a number of its `extra`."""
    return np.array([getattr(each, name) if hasattr(each, name) else each.extra[name]
                     for each in trials], float)


def share(flags: ArrayLike) -> float:
    """The share of true flags, 0 to 1; NaN without flags."""
    flags = np.asarray(flags, bool)
    return float(flags.mean()) if flags.size else np.nan


def interval(flags: ArrayLike) -> tuple[float, float]:
    """95 % interval of the share of which flags are a sample (Wilson 1927); NaN without flags."""
    flags = np.asarray(flags, bool)
    if not flags.size:
        return np.nan, np.nan
    from scipy.stats import binomtest  # here: it takes a quarter of the start of a command
    low, high = binomtest(int(flags.sum()), flags.size).proportion_ci(method='wilson')
    return float(low), float(high)


def share_with_interval(flags: ArrayLike) -> str:
    """The share of true flags as a percentage, with count and interval."""
    flags = np.asarray(flags, bool)
    low, high = interval(flags)
    return (f'{100 * share(flags):.0f} % ({flags.sum()} of {len(flags)}; {100 * low:.0f} to '
            f'{100 * high:.0f} %)')


def median(trials: Sequence[Trial], name: str) -> float:
    """The median of a field; NaN without trials."""
    return float(np.median(values(trials, name))) if trials else np.nan


def present(trials: Sequence[Trial]) -> list[Trial]:
    """The trials with something to find."""
    return [each for each in trials if each.present]


def found(trials: Sequence[Trial], name: str) -> NDArray[np.float64]:
    """(n,) an error of each trial with something to find; infinite where it is lost."""
    there = present(trials)
    return np.where(values(there, 'lost') > 0, np.inf, values(there, name))


def within(trials: Sequence[Trial], mm: float, degrees: float) -> float:
    """The share found within both bounds; flips are errors."""
    return share(within_bounds(trials, mm, degrees))


def within_bounds(trials: Sequence[Trial], mm: float, degrees: float, claimed: bool = True
                  ) -> NDArray[np.bool_]:
    """(n,) of each trial with something to find, whether its pose is within both bounds.

    claimed: only if it is not reported as lost, too.
    """
    there = present(trials)
    near = (values(there, 'translation_mm') < mm) & (values(there, 'axis_deg') < degrees)
    return near & (values(there, 'lost') == 0) if claimed else near


def success(trials: Sequence[Trial], mm: float, dots: ArrayLike, forgiving: bool
            ) -> NDArray[np.float64]:
    """(k,) the share within `mm` and at or above each bound (k,) on the dot product of the axes.

    The paper's figure of accuracy. forgiving: its absolute value counts, where there is an axis:
    upside down is right too.
    """
    there = present(trials)
    dot = values(there, 'dot')
    if forgiving:
        dot = np.where(values(there, 'symmetric') > 0, np.abs(dot), dot)
    near = found(trials, 'translation_mm') < mm
    return np.array([share(near & (dot >= bound)) for bound in np.ravel(dots)])


def cumulative(errors: ArrayLike, bounds: ArrayLike) -> NDArray[np.float64]:
    """(k,) the share of errors that are at most each bound (k,)."""
    return np.array([share(np.asarray(errors) <= bound) for bound in np.ravel(bounds)])


def average_recall(trials: Sequence[Trial]) -> tuple[float, float]:
    """BOP's AR of MSSD (0.05 to 0.5 diameters) and of MSPD (5 to 50 px of a 640 px wide view)."""
    there = present(trials)
    mssd = found(trials, 'mssd_mm') / values(there, 'diameter_mm')
    mspd = found(trials, 'mspd_px') * 640 / values(there, 'width_px')
    return tuple(float(np.mean(cumulative(errors, bounds)))  # type: ignore[return-value]
                 for errors, bounds in ((mssd, _PARTS), (mspd, _PIXELS)))


def add_s_recall(trials: Sequence[Trial]) -> float:
    """The share with an ADD-S below a tenth of the diameter."""
    return share(found(trials, 'add_s_mm') < 0.1 * values(present(trials), 'diameter_mm'))


def levels(trials: Sequence[Trial]) -> NDArray[np.float64]:
    """(n,) credible levels that hold the truth, sorted, of the trials that claim a pose.

    Those of a calibrated posterior are uniform over 0 to 1.
    """
    return np.sort(values([each for each in present(trials) if not each.lost], 'credible_level'))


def coverage(trials: Sequence[Trial], level: float) -> float:
    """The share of credible regions of this level that hold the truth."""
    return share(levels(trials) <= level)


def in_time(trials: Sequence[Trial], seconds: ArrayLike) -> NDArray[np.float64]:
    """(k,) the share found within the second of `BOUNDS`, `seconds` (k,) after the evidence."""
    taken = np.where(within_bounds(trials, *BOUNDS[1]), values(present(trials), 'seconds'), np.inf)
    return cumulative(taken, seconds)
