"""What trials of a simulated robot show: rates, causes, times."""

from collections.abc import Sequence

import numpy as np

from pmcl_ros.evaluation.recall import interval
from pmcl_ros.evaluation.results import number
from pmcl_ros.simulated_robot.trial import ManipulationTrial

HEAD = ('trials', 'of', 'done', '95 %', 'grasps at a wrong pose',
        'off at the grasp, median [mm]', '[degrees]', 'largest touch [N]',
        'rest to grasp, median [s]', '95th percentile [s]')
_TIME = 'to the grasp'


def rows(trials: Sequence[ManipulationTrial]) -> list[list[str]]:
    """A row of HEAD for all trials, and for those of each start of an object in a sink."""
    groups = [('all', list(trials))]
    if any(each.place == 'sink' for each in trials):
        groups += [('standing', [each for each in trials if each.stands]),
                   ('lying', [each for each in trials if not each.stands])]
    name_of = 'given the truth' if trials and trials[0].by_truth else 'by what it sees'
    return [[f'{name_of}, {name}', *_row(those)] for name, those in groups if those]


def causes(trials: Sequence[ManipulationTrial]) -> list[str]:
    """Why trials failed, with their seeds."""
    failed: dict[str, list[str]] = {}
    for each in trials:
        if each.cause:
            failed.setdefault(each.cause, []).append(str(each.seed))
    return [f'{cause}: {len(seeds)} (seeds {", ".join(seeds)})'
            for cause, seeds in sorted(failed.items())]


def _row(trials: Sequence[ManipulationTrial]) -> list[str]:
    done = [not each.cause for each in trials]
    low, high = interval(done)
    off = np.array([grip.off for each in trials for grip in each.grips if grip.off is not None
                    and not each.by_truth]).reshape(-1, 2)
    distance, angle = np.median(off, axis=0) if len(off) else (np.nan, np.nan)
    times = [each.times[_TIME] for each in trials if _TIME in each.times]
    middle, late = np.percentile(times, [50, 95]) if times else (np.nan, np.nan)
    return [str(len(trials)), str(sum(done)), f'{100 * low:.0f} to {100 * high:.0f} %',
            str(sum(each.wrong_grips for each in trials)), *(number(each, '') for each in (
                distance, angle, max(each.largest_touch for each in trials), middle, late))]
