"""Trials as Markdown tables and as charts."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.drawing.charts import Chart, Line, draw
from pmcl_ros.evaluation.recall import (
    BOUNDS,
    LADDER,
    add_s_recall,
    average_recall,
    coverage,
    cumulative,
    found,
    in_time,
    levels,
    median,
    present,
    share,
    success,
    values,
    within,
)
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.evaluation.variants import Variant

Picture = NDArray[np.uint8]
Trials = Sequence[Trial]

_NOTE = ('Errors: of the origin; of the axis of symmetry, or of the whole rotation where there is '
         'none; signed along the line of sight, + is too far. Medians are over all trials with '
         'something to find. In recalls a lost object counts as not found, and a flipped one as '
         'wrong. `expected`: the median of the error by the covariances, `bound`: of '
         'its Cramér-Rao bound by the evidence and the stated errors of camera poses. `of 90 %`: '
         'how many of the 90 % credible regions of claimed poses hold the truth; `of 50 %` '
         'likewise. '
         '`evaluations`: poses drawn and scored, the median.')
_SCENES = ((False, 'no film'), (True, 'behind a film'))
_CLEARLY = 15.0  # nat
_STEPS = np.linspace(0, 1, 301)  # places along a chart's axis, as a part of its length


def by_row(trials: Trials) -> dict[str, list[Trial]]:
    """The trials of each row (`mode`), in the order in which rows come."""
    rows: dict[str, list[Trial]] = {}
    for each in trials:
        rows.setdefault(each.mode, []).append(each)
    return rows


def markdown(trials: Trials) -> str:
    """All tables: by capture; by row; by row and kind of scene; of MSSD."""
    tables = [captures_table(trials)]
    if present(trials):
        tables += ['Found within the bounds:', recall_table(trials),
                   'By kind of scene (mean ± standard deviation, as in the paper):',
                   scenes_table(present(trials)),
                   'Surface within so many millimetres (MSSD):', ladder_table(trials)]
        if not np.isnan(values(present(trials), 'evidence_truth')).all():
            tables += ['Misses, by the evidence of the true pose and of the pose found:',
                       misses_table(present(trials))]
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


def recall_table(trials: Trials) -> str:
    """A line for each row."""
    bounded = bool(np.isfinite(values(present(trials), 'bound_mm')).any())  # of several views

    def cells(rows: Trials) -> list[str]:
        there = present(rows)
        bound = [each for each in there if np.isfinite(each.bound_mm)]
        mssd, mspd = average_recall(rows)
        return [
            str(len(there)), *(percent(within(rows, *bound)) for bound in BOUNDS),
            number(median(there, 'translation_mm'), ' mm'),
            number(median(there, 'told_mm'), ' mm'),
            *([number(median(bound, 'bound_mm'), ' mm')] if bounded else []),
            number(median(there, 'axis_deg'), '°'),
            percent(share([e.flipped for e in there])), percent(add_s_recall(rows)),
            percent(mssd), percent(mspd), percent(coverage(rows, 0.9)),
            percent(coverage(rows, 0.5)), percent(share([e.lost for e in there])),
            percent(share([e.lost for e in rows if e.empty])),
            percent(share([e.lost for e in rows if e.wrong])),
            number(median(there, 'evaluations'), '', 0), number(median(there, 'seconds'), ' s', 2)]

    return _row_table(trials, [
        'trials', *(f'{mm / 10:g} cm, {degrees:g}°' for mm, degrees in BOUNDS), 'median error',
        'expected', *(['bound'] if bounded else []), 'median axis error', 'flipped',
        'ADD-S < 0.1 d', 'AR MSSD', 'AR MSPD', 'of 90 %', 'of 50 %', 'lost',
        'lost, nothing there', 'lost, another object', 'evaluations', 'median time'], cells)


def scenes_table(trials: Trials) -> str:
    """A line for each row and kind of scene, of trials with something to find."""
    heads = ['mode', 'scene', 'trials', 'error', 'axis error', 'flips forgiven',
             'along the ray, median']
    lines = []
    for mode, of_mode in by_row(trials).items():
        for film, scene in _SCENES:
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


def _row_table(trials: Trials, heads: Sequence[str], cells: Callable[[Trials], list[str]]
               ) -> str:
    return table(['mode', *heads], [[mode, *cells(rows)]
                                     for mode, rows in by_row(trials).items()])


def table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    return '\n'.join([f'| {" | ".join(heads)} |', '|' + '---|' * len(heads),
                      *(f'| {" | ".join(each)} |' for each in lines)])


def number(value: float, unit: str, digits: int = 1) -> str:
    """A measured value as text; empty for NaN."""
    return '' if np.isnan(value) else f'{value:.{digits}f}{unit}'


def percent(part: float) -> str:
    """A share, 0 to 1, as text; empty for NaN."""
    return '' if np.isnan(part) else f'{100 * part:.0f} %'


def _spread(numbers: NDArray[np.float64], unit: str) -> str:
    return f'{numbers.mean():.1f} ± {numbers.std():.1f}{unit}'


def pictures(trials: Trials, variants: Sequence[Variant]) -> dict[str, Picture]:
    """All charts by name; none when there was nothing to find."""
    rows = by_row(present(trials))
    if not rows:
        return {}
    return {'success': success_picture(rows), 'errors': errors_picture(rows),
            'coverage': coverage_picture(rows), 'time': time_picture(rows, variants)}


def success_picture(rows: dict[str, list[Trial]]) -> Picture:
    """The paper's figure: found within 1 and 2 cm, over the bound on the dot product of the axes.

    Dashed: upside down counts as right. One line of charts for each kind of scene.
    """
    bounds = np.linspace(1, 0, 201)
    charts = []
    for film, scene in _SCENES:
        kind = {mode: of_film for mode, each in rows.items()
                if (of_film := [trial for trial in each if trial.film == film])}
        if kind:
            charts.append([Chart(
                f'{scene}: within {mm / 10:g} cm', 'dot product of the axes, at least', '%',
                [Line(f'{mode}{", flips forgiven" * forgiving}', bounds, 100 * success(
                    each, mm, bounds, forgiving), colour, forgiving)
                 for colour, (mode, each) in enumerate(kind.items())
                 for forgiving in (False, True)], (1, 0)) for mm in (10, 20)])
    return draw(charts)


def errors_picture(rows: dict[str, list[Trial]]) -> Picture:
    """Which share of the trials has at most so large an error."""
    names = {'translation_mm': 'error of the origin [mm]', 'axis_deg': 'error of the axis '
             '[degrees]', 'mssd_mm': 'MSSD [mm]'}
    return draw([[Chart('trials with at most this error', x_name, '%', [
        Line(mode, _STEPS * 30, 100 * cumulative(found(each, name), _STEPS * 30), colour)
        for colour, (mode, each) in enumerate(rows.items())], (0, 30))
        for name, x_name in names.items()]])


def coverage_picture(rows: dict[str, list[Trial]]) -> Picture:
    """How many credible regions of each level hold the truth, and where in them it lies.

    On the right is a histogram of the levels that reach the truth (PIT): flat if calibrated; high
    at its right end if the regions are too small.
    """
    parts, bins = np.linspace(0, 1, 101), np.linspace(0, 1, 11)
    held, shares = [], []
    for colour, (mode, each) in enumerate(rows.items()):
        reached = levels(each)
        if len(reached):
            counts = 100 * np.histogram(reached, bins)[0] / len(reached)
            held.append(Line(mode, parts, 100 * cumulative(reached, parts), colour))
            shares.append(Line(mode, np.repeat(bins, 2)[1:-1], np.repeat(counts, 2), colour))
    top = max([40.0, *(float(np.max(each.y)) for each in shares)])
    held.append(Line('calibrated', [0, 1], [0, 100], -1, dashed=True))
    shares.append(Line('calibrated', [0, 1], [10, 10], -1, dashed=True))
    return draw([[
        Chart('truth inside', 'credible level', '%', held, (0, 1)),
        Chart('where the truth lies', 'credible level that reaches it', '% of trials', shares,
              (0, 1), (0, top))]])


def time_picture(rows: dict[str, list[Trial]], variants: Sequence[Variant]) -> Picture:
    """The share found over time; of each swept parameter, the share found over its cost."""
    longest = max(1e-3, *(float(values(each, 'seconds').max()) for each in rows.values()))
    mm, degrees = BOUNDS[1]
    title = f'found within {mm / 10:g} cm, {degrees:g} degrees'
    charts = [Chart(title, 'seconds from the evidence', '%', [
        Line(mode, _STEPS * longest, 100 * in_time(each, _STEPS * longest), colour)
        for colour, (mode, each) in enumerate(rows.items())], (0, longest))]
    for group in dict.fromkeys(each.group for each in variants if each.group):
        swept = [rows[each.name] for each in variants
                 if each.group == group and each.name in rows]
        if len(swept) > 1:
            for name, label in (('seconds', 'median seconds from the evidence'),
                                ('evaluations', 'poses drawn and scored, the median')):
                spent = [median(each, name) for each in swept]
                charts.append(Chart(f'with more {group}', label, '%', [
                    Line(f'{mm / 10:g} cm, {degrees:g} degrees', spent,
                         [100 * within(each, mm, degrees) for each in swept], colour)
                    for colour, (mm, degrees) in enumerate(BOUNDS)], (0, max(*spent, 1e-3))))
    return draw([charts])
