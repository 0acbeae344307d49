"""Trials as pictures: success over the bounds, cumulative errors, how honest, how fast."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.drawing.charts import Chart, Line, draw
from pmcl_ros.evaluation.recall import (
    cumulative,
    found,
    in_time,
    levels,
    median,
    present,
    success,
    values,
    within,
)
from pmcl_ros.evaluation.tables import rows_of
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.evaluation.variants import Variant

Picture = NDArray[np.uint8]
Trials = Sequence[Trial]

_STEPS = np.linspace(0, 1, 301)


def success_picture(trials: Trials) -> Picture:
    """The paper's figure: found within 1 and 2 cm, over the bound on the dot product of the axes.

    Dashed: upside down counts as right. One line of charts for each kind of scene.
    """
    bounds = np.linspace(1, 0, 201)
    rows_of_charts = []
    for film, scene in ((False, 'no film'), (True, 'behind a film')):
        kind = [each for each in present(trials) if each.film == film]
        if kind:
            rows_of_charts.append([Chart(
                f'{scene}: within {mm / 10:g} cm', 'dot product of the axes, at least', '%',
                [Line(f'{mode}{", flips forgiven" * forgiving}', bounds, 100 * success(
                    rows, mm, bounds, forgiving), colour, forgiving)
                 for colour, (mode, rows) in enumerate(_by_row(kind))
                 for forgiving in (False, True)], (1, 0)) for mm in (10, 20)])
    return draw(rows_of_charts)


def errors_picture(trials: Trials) -> Picture:
    """Which share of the trials has at most so large an error."""
    names = (('translation_mm', 'error of the origin [mm]', 30),
             ('axis_deg', 'error of the axis [degrees]', 30),
             ('mssd_mm', 'MSSD [mm]', 30))
    return draw([[Chart('trials with at most this error', x_name, '%', [
        Line(mode, _STEPS * most, 100 * cumulative(found(rows, name), _STEPS * most), colour)
        for colour, (mode, rows) in enumerate(_by_row(present(trials)))],
        (0, most)) for name, x_name, most in names]])


def coverage_picture(levels_by_row: Mapping[str, NDArray[np.float64]]) -> Picture:
    """How many credible regions of each level hold the truth, and where in them it lies.

    levels_by_row: (n,) the level that reaches the truth, of each trial. On the right is their
    histogram (PIT): flat if calibrated; high at its right end if the regions are too small.
    """
    parts, bins = np.linspace(0, 1, 101), np.linspace(0, 1, 11)
    held, shares = [], []
    for colour, (mode, each) in enumerate(levels_by_row.items()):
        if len(each):
            counts = 100 * np.histogram(each, bins)[0] / len(each)
            held.append(Line(mode, parts, 100 * cumulative(each, parts), colour))
            shares.append(Line(mode, np.repeat(bins, 2)[1:-1], np.repeat(counts, 2), colour))
    top = max([40.0, *(float(np.max(each.y)) for each in shares)])
    held.append(Line('calibrated', [0, 1], [0, 100], -1, dashed=True))
    shares.append(Line('calibrated', [0, 1], [10, 10], -1, dashed=True))
    return draw([[
        Chart('truth inside', 'credible level', '%', held, (0, 1)),
        Chart('where the truth lies', 'credible level that reaches it', '% of trials', shares,
              (0, 1), (0, top))]])


def time_picture(trials: Trials, variants: Sequence[Variant]) -> Picture:
    """What is found in how much time; where one value was swept, what more of it buys."""
    longest = float(np.max(values(present(trials), 'seconds'), initial=1e-3))
    charts = [Chart('found within 1 cm, 10 degrees', 'seconds from the volume', '%', [
        Line(mode, _STEPS * longest, 100 * in_time(rows, _STEPS * longest), colour)
        for colour, (mode, rows) in enumerate(_by_row(present(trials)))],
        (0, longest))]
    by_name = dict(_by_row(present(trials)))
    for group in dict.fromkeys(each.group for each in variants if each.group):
        swept = [by_name[each.name] for each in variants
                 if each.group == group and each.name in by_name]
        if len(swept) > 1:
            for name, label in (('seconds', 'median seconds from the volume'),
                                ('evaluations', 'poses drawn and scored, the median')):
                spent = [median(rows, name) for rows in swept]
                lines = [Line(f'{mm / 10:g} cm, {degrees:g} degrees', spent,
                              [100 * within(rows, mm, degrees) for rows in swept], colour)
                         for colour, (mm, degrees) in enumerate(((20, 10), (10, 10), (5, 5)))]
                charts.append(Chart(f'with more {group}', label, '%', lines,
                                    (0, max(*spent, 1e-3))))
    return draw([charts])


def pictures(trials: Trials, variants: Sequence[Variant]) -> dict[str, Picture]:
    """All of them by name; none when there was nothing to find."""
    if not present(trials):
        return {}
    return {'success': success_picture(trials), 'errors': errors_picture(trials),
            'coverage': coverage_picture({mode: levels(rows) for mode, rows
                                          in _by_row(present(trials))}),
            'time': time_picture(trials, variants)}


def _by_row(trials: Trials) -> list[tuple[str, list[Trial]]]:
    return [(mode, [each for each in trials if each.mode == mode]) for mode in rows_of(trials)]
