"""Trials as Markdown tables."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.recall import (
    BOUNDS,
    LADDER,
    add_s_recall,
    average_recall,
    coverage,
    cumulative,
    found,
    median,
    present,
    share,
    values,
    within,
)
from pmcl_ros.evaluation.trials import Trial

Trials = Sequence[Trial]

_NOTE = ('Errors: of the origin; of the axis of symmetry, or of the whole rotation where there is '
         'none; signed along the line of sight, + is too far. Medians are over all trials with '
         'something to find. In recalls a lost object counts as not found, and a flipped one as '
         'wrong. `of 90 %`: how many of the 90 % credible regions of claimed poses hold the '
         'truth; `of 50 %` likewise. `evaluations`: poses drawn and scored, the median.')


def rows_of(trials: Trials) -> list[str]:
    """The names of the rows, in the order in which they come."""
    return list(dict.fromkeys(each.mode for each in trials))


def markdown(trials: Trials) -> str:
    """All tables: by capture; by row; by row and kind of scene; of MSSD."""
    there = present(trials)
    tables = [captures_table(trials)]
    if there:
        tables += ['Found within the bounds:', recall_table(trials),
                   'By kind of scene (mean ± standard deviation, as in the paper):',
                   scenes_table(there),
                   'Surface within so many millimetres (MSSD):', ladder_table(trials)]
    return '\n\n'.join([*tables, _NOTE])


def captures_table(trials: Trials) -> str:
    """A line for each capture and row, where another object was sought one more."""
    heads = ['capture', 'mode', 'trials', 'median error', 'worst', 'along the ray',
             'median axis error', 'flipped', 'lost', 'of 90 %', 'evaluations', 'median time']
    lines = []
    for capture, mode, wrong in dict.fromkeys((e.capture, e.mode, e.wrong) for e in trials):
        rows = [e for e in trials if (e.capture, e.mode, e.wrong) == (capture, mode, wrong)]
        lost = f'{sum(each.lost for each in rows)} of {len(rows)}'
        if present(rows):
            mm = values(rows, 'translation_mm')
            errors = [f'{np.median(mm):.1f} mm', f'{mm.max():.1f} mm',
                      f'{median(rows, "ray_mm"):+.1f} mm', f'{median(rows, "axis_deg"):.1f}°',
                      f'{sum(each.flipped for each in rows)}', lost,
                      _percent(coverage(rows, 0.9))]
        else:
            errors = [f'({"another object" if wrong else "nothing"} there)', '', '', '', '', lost,
                      '']
        lines.append([capture, mode, str(len(rows)), *errors,
                      f'{median(rows, "evaluations"):.0f}',
                      f'{median(rows, "seconds"):.1f} s'])
    return _table(heads, lines)


def recall_table(trials: Trials) -> str:
    """A line for each row."""
    columns: dict[str, Callable[[Trials], str]] = {
        'trials': lambda rows: str(len(present(rows))),
        **{f'{mm / 10:g} cm, {degrees:g}°': partial(_within, mm=mm, degrees=degrees)
           for mm, degrees in BOUNDS},
        'median error': lambda rows: f'{median(present(rows), "translation_mm"):.1f} mm',
        'median axis error': lambda rows: f'{median(present(rows), "axis_deg"):.1f}°',
        'flipped': lambda rows: _percent(share([e.flipped for e in present(rows)])),
        'ADD-S < 0.1 d': lambda rows: _percent(add_s_recall(rows)),
        'AR MSSD': lambda rows: _percent(average_recall(rows)[0]),
        'AR MSPD': lambda rows: _percent(average_recall(rows)[1]),
        'of 90 %': lambda rows: _percent(coverage(rows, 0.9)),
        'of 50 %': lambda rows: _percent(coverage(rows, 0.5)),
        'lost': lambda rows: _percent(share([e.lost for e in present(rows)])),
        'lost, nothing there': lambda rows: _percent(share([e.lost for e in rows if e.empty])),
        'lost, another object': lambda rows: _percent(share([e.lost for e in rows if e.wrong])),
        'evaluations': lambda rows: f'{median(present(rows), "evaluations"):.0f}',
        'median time': lambda rows: f'{median(present(rows), "seconds"):.2f} s'}
    return _by_row(trials, columns)


def scenes_table(trials: Trials) -> str:
    """A line for each row and kind of scene, of trials with something to find."""
    heads = ['mode', 'scene', 'trials', 'error', 'axis error', 'flips forgiven',
             'along the ray, median']
    lines = []
    for mode in rows_of(trials):
        for film, scene in ((False, 'no film'), (True, 'behind a film')):
            rows = [e for e in trials if e.mode == mode and e.film == film]
            if rows:
                axis = values(rows, 'axis_deg')
                forgiven = np.where(values(rows, 'symmetric') > 0, np.minimum(axis, 180 - axis),
                                    axis)
                lines.append([mode, scene, str(len(rows)),
                              _spread(values(rows, 'translation_mm'), ' mm'), _spread(axis, '°'),
                              _spread(forgiven, '°'), f'{median(rows, "ray_mm"):+.1f} mm'])
    return _table(heads, lines)


def ladder_table(trials: Trials) -> str:
    """A line for each row, a column for each bound."""
    return _by_row(trials, {f'{mm} mm': partial(_near, mm=mm) for mm in LADDER})


def _within(rows: Trials, mm: float, degrees: float) -> str:
    return _percent(within(rows, mm, degrees))


def _near(rows: Trials, mm: float) -> str:
    return _percent(float(cumulative(found(rows, 'mssd_mm'), mm)[0]))


def _by_row(trials: Trials, columns: dict[str, Callable[[Trials], str]]) -> str:
    lines = []
    for mode in rows_of(trials):
        rows = [each for each in trials if each.mode == mode]
        lines.append([mode, *(cell(rows) for cell in columns.values())])
    return _table(['mode', *columns], lines)


def _table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    return '\n'.join([f'| {" | ".join(heads)} |', '|' + '---|' * len(heads),
                      *(f'| {" | ".join(each)} |' for each in lines)])


def _percent(part: float) -> str:
    return '' if np.isnan(part) else f'{100 * part:.0f} %'


def _spread(numbers: NDArray[np.float64], unit: str) -> str:
    return f'{numbers.mean():.1f} ± {numbers.std():.1f}{unit}'
