"""Drawings of the search: poses of each stage, and how they narrow."""

from itertools import groupby
from typing import NamedTuple

import cv2
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pmcl_ros.drawing.pictures import displayed
from pmcl_ros.evaluation.report.html import Figure
from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.svg import axes, colour, dots, lines, over, svg
from pmcl_ros.pmcl.history import Generation, Stage

_THIN = 0.8  # px


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


def stage_map(run: Localization, stage: Stage, name: str) -> Figure | None:
    """Where the particles of a stage's end have the object's origin; None without the stage."""
    generations = [each for each in run.history if each.stage == stage]
    if not generations:
        return None
    poses = generations[-1].poses
    pinhole = run.source.pinhole
    window = run.region.window(pinhole, run.model.radius)
    grey = cv2.cvtColor(displayed(run.source), cv2.COLOR_RGB2GRAY)
    made = over(np.asarray(grey, np.uint8), (window.left, window.top, *window.size))
    dots(made, pinhole.project(poses[:, :3, 3]), 'on-particle', 1.8)
    return Figure(svg(made, f'particles: {stage}'), f'{name.capitalize()}: where {len(poses)} '
                  "particles have the object's origin.")


def spreads(history: tuple[Generation, ...]) -> Markup:
    """The particles' spread across (blue) and along (orange) the line of sight."""
    found = 1e3 * np.maximum([spread(each.poses) for each in history], 1e-7)
    made = _generations(history, (float(found.min()) / 1.5, float(found.max()) * 1.5),
                        'spread [mm]')
    made.set_yscale('log')
    made.yaxis.set_major_formatter('{x:g}')
    made.minorticks_off()
    for values, name in zip(found.T, ('blue', 'orange'), strict=True):
        _series(made, np.arange(1, len(history) + 1), values, name)
    return svg(made, 'spread of the particles')


def scores(history: tuple[Generation, ...]) -> Markup:
    """The best (blue) and the median (orange) score; units differ: each stage in its own range."""
    made = _generations(history, (-0.05, 1.05), 'score, relative')
    start = 1
    for _, group in groupby(history, lambda each: each.stage):
        finite = [each.scores[np.isfinite(each.scores)] for each in group]
        best, median = (np.array([function(each) if len(each) else np.nan for each in finite])
                        for function in (np.max, np.median))
        low, high = np.nanmin([best, median]), np.nanmax([best, median])
        for values, name in ((best, 'blue'), (median, 'orange')):
            _series(made, np.arange(start, start + len(finite)),
                    (values - low) / max(float(high - low), 1e-12), name)
        start += len(finite)
    return svg(made, 'scores of the particles')


def _generations(history: tuple[Generation, ...], reach: tuple[float, float], name: str) -> Axes:
    """Axes over generations, with lines between the stages."""
    made = axes((0.5, len(history) + 0.5), reach, 'generation', name)
    for k in range(1, len(history)):
        if history[k].stage != history[k - 1].stage:
            made.axvline(k + 0.5, color=colour('soft'), linewidth=_THIN)
    return made


def _series(made: Axes, numbers: NDArray[np.int64], values: NDArray[np.float64], name: str
            ) -> None:
    points = np.stack([numbers, values], axis=1)
    lines(made, [points], name)
    dots(made, points, name)
