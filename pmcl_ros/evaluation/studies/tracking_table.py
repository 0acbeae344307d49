"""What played sequences say: a table, and errors over frames as a picture."""

from collections.abc import Callable
from collections.abc import Sequence as Many

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.drawing.charts import Chart, Line, draw
from pmcl_ros.evaluation.studies.tracking import Outcome, Played

_MOST = 30.0  # mm: the picture ends there


def recovery(frames: Many[Played]) -> int | None:
    """How many frames after an occlusion, counted from 1, the object was found; None: not at all.

    Found: as `Outcome.right`. -1 where nothing is occluded, or nothing comes after it.
    """
    last = max((each.number for each in frames if each.occluded), default=None)
    after = [each for each in frames if last is not None and each.number > last]
    if not after:
        return -1
    return next((k for k, each in enumerate(after, 1) if each.tracked.right), None)


def row(name: str, frames: Many[Played]) -> dict[str, str]:
    """A line of the table: of one sequence, or of several after each other."""
    seen = [each for each in frames if not each.occluded]
    both = [(each.tracked, each.single) for each in seen if each.single is not None]
    tracked, single = [each for each, _ in both], [each for _, each in both]
    followed = [each.tracked for each in seen if each.tracked.way == 'followed']
    hidden = [each.tracked for each in frames if each.occluded]
    return {
        'sequence': name,
        'error tracked [mm]': _median(tracked, 'translation', 1e3),
        'single [mm]': _median(single, 'translation', 1e3),
        'more [mm]': _difference(both),
        'axis tracked [deg]': _median(tracked, 'rotation', 180 / np.pi),
        'single [deg]': _median(single, 'rotation', 180 / np.pi),
        'right tracked': _share([each.right for each in tracked]),
        'single': _share([each.right for each in single]),
        'followed': f'{len(followed)} of {len(seen)}',
        'lost': str(sum(each.tracked.lost for each in seen)),
        'wrong': str(sum(not each.tracked.lost and not each.tracked.right for each in seen)),
        'claimed while hidden': f'{sum(not each.lost for each in hidden)} of {len(hidden)}',
        'in the 90 % region': _share([each.level <= 0.9 for each in followed]),
        'tracked [ms]': _median([each.tracked for each in seen], 'seconds', 1e3),
        'single [ms]': _median(single, 'seconds', 1e3),
        'times as fast': _ratio(single, [each.tracked for each in seen], 'seconds'),
        'by CPU time': _ratio(single, [each.tracked for each in seen], 'cpu'),
        'on average': _ratio(single, [each.tracked for each in seen], 'seconds', np.mean),
        'slowest [ms]': _largest([each.tracked for each in frames]),
        'edges [ms]': f'{1e3 * np.median([each.volume_seconds for each in frames]):.0f}'}


def table(rows: Many[dict[str, str]]) -> str:
    """Rows that share their columns, as Markdown."""
    lines = [list(rows[0]), ['---'] * len(rows[0]), *(list(each.values()) for each in rows)]
    return '\n'.join(f'| {" | ".join(each)} |' for each in lines)


def recoveries(found: Many[int | None]) -> str:
    """One sentence about `recovery` of several sequences."""
    found = [each for each in found if each != -1]
    if not found:
        return 'nothing was occluded'
    soon = sum(each is not None and each <= 3 for each in found)
    told = ', '.join('never' if each is None else str(each) for each in found)
    return (f'found within three frames after the occlusion: {soon} of {len(found)} '
            f'(in frame {told})')


def picture(name: str, frames: Many[Played]) -> NDArray[np.uint8]:
    """Errors over frames; a line is broken where the object is said to be lost."""
    def errors(outcomes: Many[Outcome | None]) -> NDArray[np.float64]:
        return np.array([np.nan if each is None or each.lost else
                         min(1e3 * each.translation, _MOST) for each in outcomes])

    numbers = np.array([each.number for each in frames])
    hidden = np.where([each.occluded for each in frames], 0.0, np.nan)
    compared = [each for each in frames if each.single is not None]
    lines = [Line('tracked', numbers, errors([each.tracked for each in frames])),
             Line('standard deviation', numbers,
                  np.minimum([1e3 * each.tracked.sigma for each in frames], _MOST), 4, True),
             Line('hidden', numbers, hidden, 3)]
    if compared:
        lines.append(Line('single shots', np.array([each.number for each in compared]),
                          errors([each.single for each in compared]), 1))
    return draw([[Chart(name, 'frame', 'error [mm]', lines, (0, max(len(frames) - 1, 1)),
                        (0, _MOST))]], width=8)


def _median(outcomes: Many[Outcome], name: str, unit: float) -> str:
    if not outcomes:
        return ''
    return f'{unit * float(np.median([getattr(each, name) for each in outcomes])):.1f}'


def _difference(both: Many[tuple[Outcome, Outcome]]) -> str:
    """Of errors, tracked less single, of the frames that both get right: median, its error.

    The error is that of a median of so many independent differences.
    """
    found = np.array([tracked.translation - single.translation for tracked, single in both
                      if tracked.right and single.right])
    if not len(found):
        return ''
    quarter, middle, three = 1e3 * np.percentile(found, [25, 50, 75])
    # Of a Gaussian: quartiles are 1.349 sigma apart, a median scatters by 1.253 sigma / sqrt(n).
    return f'{middle:+.2f} ± {0.93 * (three - quarter) / np.sqrt(len(found)):.2f}'


def _ratio(slow: Many[Outcome], fast: Many[Outcome], name: str,
           typical: Callable[[list[float]], np.floating] = np.median) -> str:
    if not slow or not fast:
        return ''
    first, last = (float(typical([getattr(each, name) for each in outcomes]))
                   for outcomes in (slow, fast))
    return f'{first / last:.1f}'


def _largest(outcomes: Many[Outcome]) -> str:
    return f'{1e3 * max(each.seconds for each in outcomes):.0f}'


def _share(flags: Many[bool]) -> str:
    return f'{100 * np.mean(flags):.0f} %' if flags else ''
