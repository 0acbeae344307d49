"""How the search went: where its particles were, how far apart, and what evidence they had."""

from itertools import groupby
from typing import NamedTuple
from xml.etree.ElementTree import Element

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.markup import figure, figures, key, section, table
from pmcl_ros.evaluation.report.plot import Plot
from pmcl_ros.evaluation.report.views import over
from pmcl_ros.pmcl.history import Generation, Stage

NAMES: dict[str, str] = {
    'proposals': 'proposals', 'coarse': 'climbed, by coarse contours',
    'fine': 'the best, by fine contours', 'rivals': 'with rivals',
    'scattered': 'begun again around them',
    'modes': 'modes, refined', 'approximate': 'posterior, approximated',
    'posterior': 'posterior', 'filter': 'particle filter'}
_MAPPED: tuple[Stage, ...] = ('proposals', 'coarse', 'posterior', 'filter')


class Spread(NamedTuple):
    """Standard deviations of the particles' places [m], across and along the line of sight."""

    across: float
    along: float


def spread(poses: NDArray[np.float64]) -> Spread:
    """Of poses (n, 4, 4); across is the root mean square of the two directions."""
    places = poses[:, :3, 3]
    mean = places.mean(axis=0)
    ray = mean / max(float(np.linalg.norm(mean)), 1e-9)
    along = (places - mean) @ ray
    rest = ((places - mean) ** 2).sum(axis=1) - along ** 2
    return Spread(float(np.sqrt(max(rest.mean(), 0) / 2)), float(along.std()))


def search_section(run: Localization) -> Element:
    """The stages in a table, their particles over the picture, spread and evidence over time."""
    if not run.history:
        return section('How it was found', 'search', 'The search kept no history.')
    return section(
        'How it was found', 'search', table(
            ['stage', 'generations', 'particles', 'across [mm]', 'along [mm]',
             'best score', 'took [ms]'], _rows(run)),
        figures(*(_map(run, each) for each in _MAPPED if _of(run.history, each))),
        figures(figure(_spreads(run.history), 'How far apart the particles are, generation by '
                       'generation.', key(('blue', 'across the line of sight'),
                                          ('orange', 'along it'))),
                figure(_scores(run.history), 'Their scores, within each stage from the lowest '
                       'median (0) to the best (1): the units differ.', key(('blue', 'best'),
                                                             ('orange', 'median')))))


def _of(history: tuple[Generation, ...], stage: Stage) -> list[Generation]:
    return [each for each in history if each.stage == stage]


def _rows(run: Localization) -> list[list[str]]:
    rows = []
    for stage, group in groupby(run.history, lambda each: each.stage):
        generations = list(group)
        last = generations[-1]
        apart = spread(last.poses)
        rows.append([NAMES[stage], f'{len(generations)}', f'{len(last.poses)}',
                     f'{1e3 * apart.across:.2f}', f'{1e3 * apart.along:.2f}',
                     f'{np.max(last.scores):.4g}',
                     f'{1e3 * run.seconds[stage]:.0f}'])
    return rows


def _map(run: Localization, stage: Stage) -> Element:
    last = _of(run.history, stage)[-1]
    pinhole = run.light_field.grid.pinhole
    window = run.region.window(pinhole, run.model.radius)
    grey = cv2.cvtColor(run.light_field.picture(), cv2.COLOR_RGB2GRAY)
    plot = over(np.asarray(grey), (window.left, window.top, *window.size), stage)
    pixels = pinhole.project(last.poses[:, :3, 3])
    plot.dots(pixels[:, 0], pixels[:, 1], 'particle', 1.8)
    return figure(plot.svg, f'{NAMES[stage].capitalize()}: where {len(last.poses)} '
                  "particles have the object's origin.")


def _spreads(history: tuple[Generation, ...]) -> Element:
    found = 1e3 * np.maximum([spread(each.poses) for each in history], 1e-7)
    number = np.arange(1, len(history) + 1)
    plot = Plot((0.5, len(history) + 0.5), (float(found.min()) / 1.5, float(found.max()) * 1.5),
                'generation', 'spread [mm]', log=True, title='spread of the particles')
    _bands(plot, history, float(found.min()) / 1.5, float(found.max()) * 1.5)
    for column, kind in ((0, 'blue'), (1, 'orange')):
        plot.line(number, found[:, column], kind)
        plot.dots(number, found[:, column], kind)
    return plot.svg


def _scores(history: tuple[Generation, ...]) -> Element:
    """Scores of different stages have different units: each is drawn within its own range."""
    plot = Plot((0.5, len(history) + 0.5), (-0.05, 1.05), 'generation', 'score, relative',
                title='scores of the particles')
    _bands(plot, history, -0.05, 1.05)
    start = 1
    for _, group in groupby(history, lambda each: each.stage):
        scores = [each.scores[np.isfinite(each.scores)] for each in group]
        best, median = (np.array([function(each) if len(each) else np.nan for each in scores])
                        for function in (np.max, np.median))
        low, high = np.nanmin([best, median]), np.nanmax([best, median])
        number = np.arange(start, start + len(scores))
        for values, kind in ((best, 'blue'), (median, 'orange')):
            relative = (values - low) / max(float(high - low), 1e-12)
            plot.line(number, relative, kind)
            plot.dots(number, relative, kind)
        start += len(scores)
    return plot.svg


def _bands(plot: Plot, history: tuple[Generation, ...], low: float, high: float) -> None:
    """Lines between the stages."""
    for k in range(1, len(history)):
        if history[k].stage != history[k - 1].stage:
            plot.line([k + 0.5, k + 0.5], [low, high], 'border')
