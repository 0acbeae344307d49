"""Trials as Markdown tables."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmcl_ros.evaluation.recall import (
    BOUNDS,
    LADDER,
    add_s_recall,
    average_recall,
    coverage,
    cumulative,
    found,
    levels,
    median,
    present,
    share,
    share_with_interval,
    values,
    within_bounds,
)
from pmcl_ros.evaluation.trials import Trial

Trials = Sequence[Trial]

_NOTE = ('Errors: of the origin; of the axis of symmetry, or of the whole rotation where there is '
         'none; signed along the line of sight, + is too far. Medians are over all trials with '
         'something to find. In recalls a lost object counts as not found, and a flipped one as '
         'wrong. `expected`: the median of the error by the covariances, `bound`: of '
         'its Cramér-Rao bound by the evidence and the stated errors of camera poses. `of 90 %`: '
         'how many of the 90 % credible regions of claimed poses hold the truth. '
         'Rates: count, and 95 % interval (Wilson). '
         '`evaluations`: poses drawn and scored, the median.')
SCENES = ((False, 'no film'), (True, 'behind a film'))
_CLEARLY = 15.0  # nat


def by_row(trials: Trials) -> dict[str, list[Trial]]:
    """The trials of each row (`mode`), in the order in which rows come."""
    rows: dict[str, list[Trial]] = {}
    for each in trials:
        rows.setdefault(each.mode, []).append(each)
    return rows


def markdown(trials: Trials) -> str:
    """All tables: by capture; by row; by row and kind of scene; of MSSD."""
    tables = [captures_table(trials)]
    tables += ['Rates:', rates_table(trials)]
    if present(trials):
        tables += ['Errors:', errors_table(trials),
                   'By kind of scene (mean ± standard deviation, as in the paper):',
                   scenes_table(present(trials)),
                   'Surface within so many millimetres (MSSD):', ladder_table(trials)]
        if not np.isnan(values(present(trials), 'evidence_truth')).all():
            tables += ['Misses, by the evidence of the true pose and of the pose found:',
                       misses_table(present(trials))]
        if missed := [each for each in present(trials) if not each.found]:
            tables += ['What was not found:', missed_table(missed)]
    return '\n\n'.join([*tables, _NOTE])


def captures_table(trials: Trials) -> str:
    """A line for each capture and row; one more where another object was sought."""
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
                      percent(coverage(rows, 0.9))]
        else:
            errors = [f'({"another object" if wrong else "nothing"} there)', '', '', '', '', lost,
                      '']
        lines.append([capture, mode, str(len(rows)), *errors,
                      f'{median(rows, "evaluations"):.0f}', f'{median(rows, "seconds"):.1f} s'])
    return table(heads, lines)


def rates_table(trials: Trials) -> str:
    """A line for each rate, with count and 95 % interval; a column for each row of trials."""
    rows = [*by_row(trials).values()]
    rates: dict[str, Sequence[ArrayLike]] = {}
    for mm, degrees in BOUNDS:
        for words, claimed in (('claimed, ', True), ('', False)):
            rates[f'{words}within {mm / 10:g} cm, {degrees:g}°'] = [
                within_bounds(each, mm, degrees, claimed) for each in rows]
    rates['claimed, not right'] = [[not e.lost and not e.near for e in present(each)]
                                   for each in rows]
    for level in (0.9, 0.5):
        rates[f'claimed, truth in the {100 * level:.0f} % region'] = [
            levels(each) <= level for each in rows]
    rates['lost, nothing there'] = [[e.lost for e in each if e.empty] for each in rows]
    rates['lost, another object'] = [[e.lost for e in each if e.wrong] for each in rows]
    return table(['rate', *by_row(trials)], [
        [words, *(share_with_interval(flags) if np.size(flags) else '' for flags in each)]
        for words, each in rates.items() if any(map(np.size, each))])


def errors_table(trials: Trials) -> str:
    """A line for each row."""
    bounded = bool(np.isfinite(values(present(trials), 'bound_mm')).any())  # of several views

    def cells(rows: Trials) -> list[str]:
        there = present(rows)
        bound = [each for each in there if np.isfinite(each.bound_mm)]
        mssd, mspd = average_recall(rows)
        return [
            str(len(there)),
            number(median(there, 'translation_mm'), ' mm'),
            number(median(there, 'told_mm'), ' mm'),
            *([number(median(bound, 'bound_mm'), ' mm')] if bounded else []),
            number(median(there, 'axis_deg'), '°'),
            percent(share([e.flipped for e in there])), percent(add_s_recall(rows)),
            percent(mssd), percent(mspd), percent(share([e.lost for e in there])),
            number(median(there, 'evaluations'), '', 0), number(median(there, 'seconds'), ' s', 2)]

    return _row_table(trials, [
        'trials', 'median error', 'expected', *(['bound'] if bounded else []),
        'median axis error', 'flipped', 'ADD-S < 0.1 d', 'AR MSSD', 'AR MSPD', 'lost',
        'evaluations', 'median time'], cells)


def scenes_table(trials: Trials) -> str:
    """A line for each row and kind of scene, of trials with something to find."""
    heads = ['mode', 'scene', 'trials', 'error', 'axis error', 'flips forgiven',
             'along the ray, median']
    lines = []
    for mode, of_mode in by_row(trials).items():
        for film, scene in SCENES:
            rows = [each for each in of_mode if each.film == film]
            if rows:
                axis = values(rows, 'axis_deg')
                forgiven = np.where(values(rows, 'symmetric') > 0, np.minimum(axis, 180 - axis),
                                    axis)
                lines.append([mode, scene, str(len(rows)),
                              _spread(values(rows, 'translation_mm'), ' mm'), _spread(axis, '°'),
                              _spread(forgiven, '°'), f'{median(rows, "ray_mm"):+.1f} mm'])
    return table(heads, lines)


def ladder_table(trials: Trials) -> str:
    """A line for each row, a column for each bound on MSSD."""
    return _row_table(trials, [f'{mm} mm' for mm in LADDER], lambda rows: [
        percent(each) for each in cumulative(found(rows, 'mssd_mm'), LADDER)])


def misses_table(trials: Trials) -> str:
    """A line for each row, of trials with something to find.

    A miss with more evidence at the true pose is the search's, with less the evidence's.
    """
    def cells(rows: Trials) -> list[str]:
        more = values(rows, 'evidence_truth') - values(rows, 'evidence_found')  # at the truth
        known = np.isfinite(more)  # not in the mode faithful
        missed = np.array([not each.near for each in rows])
        claimed = np.array([not each.lost for each in rows])
        why = [str((missed & (more > 0)).sum()), str((missed & (more <= 0)).sum())]
        return [str(len(rows)), str(missed.sum()), *(why if known.any() else ('', '')),
                str((missed & claimed).sum()), percent(share(more[known] >= -_CLEARLY)),
                percent(share(more[known] > _CLEARLY))]

    return _row_table(trials, [
        'trials', 'misses', 'search', 'evidence', 'claimed',
        f'truth at most {_CLEARLY:g} nat below', f'truth over {_CLEARLY:g} nat above'], cells)


def missed_table(trials: Trials) -> str:
    """A line for each of these trials: what was found there, and by which evidence."""
    heads = ['capture', 'mode', 'seed', 'reported', 'error', 'axis error', 'evidence found [nat]',
             'at the truth', 'at fault']

    def fault(each: Trial) -> str:
        if each.near:
            return 'claim'
        if np.isnan(each.evidence_truth):
            return ''
        return 'search' if each.evidence_truth > each.evidence_found else 'evidence'

    return table(heads, [[
        each.capture, each.mode, str(each.seed), 'lost' if each.lost else 'claimed',
        number(each.translation_mm, ' mm'), number(each.axis_deg, '°'),
        number(each.evidence_found, '', 0), number(each.evidence_truth, '', 0), fault(each)]
        for each in trials])


def _row_table(trials: Trials, heads: Sequence[str], cells: Callable[[Trials], list[str]]
               ) -> str:
    return table(['mode', *heads], [[mode, *cells(rows)]
                                     for mode, rows in by_row(trials).items()])


def table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    return '\n'.join([f'| {" | ".join(heads)} |', '|' + '---|' * len(heads),
                      *(f'| {" | ".join(each)} |' for each in lines)])


def table_and_list(heads: Sequence[str], lines: Iterable[Sequence[str]],
                   remarks: Iterable[str]) -> str:
    """A Markdown table, and a list below it."""
    return '\n'.join([table(heads, lines), '', *(f'- {each}' for each in remarks)])


def number(value: float, unit: str, digits: int = 1) -> str:
    """A measured value as text; empty for NaN."""
    return '' if np.isnan(value) else f'{value:.{digits}f}{unit}'


def percent(part: float) -> str:
    """A share, 0 to 1, as text; empty for NaN."""
    return '' if np.isnan(part) else f'{100 * part:.0f} %'


def _spread(numbers: NDArray[np.float64], unit: str) -> str:
    return f'{numbers.mean():.1f} ± {numbers.std():.1f}{unit}'
