"""Trials as charts."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.drawing.charts import Chart, Line, draw
from pmcl_ros.evaluation.recall import (
    BOUNDS,
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
from pmcl_ros.evaluation.results import SCENES, by_row
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.evaluation.variants import Variant

Picture = NDArray[np.uint8]
Rows = dict[str, list[Trial]]  # by the name of the row

_STEPS = np.linspace(0, 1, 301)  # places along a chart's axis, as a part of its length


def pictures(trials: Sequence[Trial], variants: Sequence[Variant]) -> dict[str, Picture]:
    """All charts by name; none when there was nothing to find."""
    rows = by_row(present(trials))
    if not rows:
        return {}
    return {'success': success_picture(rows), 'errors': errors_picture(rows),
            'coverage': coverage_picture(rows), 'time': time_picture(rows, variants)}


def success_picture(rows: Rows) -> Picture:
    """The paper's figure: found within 1 and 2 cm, over the bound on the dot product of the axes.

    Dashed: upside down counts as right. One line of charts for each kind of scene.
    """
    bounds = np.linspace(1, 0, 201)
    charts = []
    for film, scene in SCENES:
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


def errors_picture(rows: Rows) -> Picture:
    """Which share of the trials has at most so large an error."""
    names = {'translation_mm': 'error of the origin [mm]', 'axis_deg': 'error of the axis '
             '[degrees]', 'mssd_mm': 'MSSD [mm]'}
    return draw([[Chart('trials with at most this error', x_name, '%', [
        Line(mode, _STEPS * 30, 100 * cumulative(found(each, name), _STEPS * 30), colour)
        for colour, (mode, each) in enumerate(rows.items())], (0, 30))
        for name, x_name in names.items()]])


def coverage_picture(rows: Rows) -> Picture:
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


def time_picture(rows: Rows, variants: Sequence[Variant]) -> Picture:
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
