"""Figures about several views: how sure they make a pose, and what one more would bring.

`charts.picture` makes arrays of them.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import ArrayLike, NDArray

from pmcl_ros.drawing.charts import Chart, Line, figure
from pmcl_ros.pmcl.multi_view.next_view import NextView, angles_around

_SIZE = 5.6, 4.4  # inches
_DPI = 100
_RING = 15.0  # degrees between two circles
_GRID, _RINGED = '#dddddd', '#d55e00'
_MARGIN = 6.0  # degrees beyond the farthest camera


def sigmas_figure(sigmas: ArrayLike) -> Figure:
    """Standard deviations (n,) of the position by the first 1, 2, ..., n views [m], in mm.

    Views before the first that sees the region of interest have NaN.
    """
    values = 1e3 * np.ravel(np.asarray(sigmas, float))
    numbers = np.arange(1, len(values) + 1)
    known = values[np.isfinite(values)]
    low, high = (known.min(), known.max()) if len(known) else (1.0, 1.0)
    made = figure([[Chart('how sure the position is', 'first views', 'standard deviation [mm]',
                          [Line('found', numbers, values)], (0.5, len(values) + 0.5),
                          (low / 1.5, 1.5 * high))]])
    axes = made.axes[0]
    axes.lines[0].set_marker('o')
    axes.get_legend().remove()  # type: ignore[union-attr]
    axes.set(yscale='log', xticks=numbers)
    axes.set_yticks(_ticks(low / 1.5, 1.5 * high))
    axes.yaxis.set_major_formatter('{x:g}')
    axes.minorticks_off()
    for number, value in zip(numbers, values, strict=True):
        if np.isfinite(value):
            axes.annotate(f'{value:.2g}', (number, value), (0, 6), textcoords='offset points',
                          ha='center', fontsize='small')
    return made


def next_views_figure(found: Sequence[NextView], pose: NDArray[np.float64],
                      cameras: Sequence[NDArray[np.float64]]) -> Figure:
    """Candidates by their directions, coloured by what is expected with a view from there.

    found: as `next_views` gives them. pose: (4, 4) of the object, cameras: (4, 4) of the views
    there are: candidates are drawn by their angles from the middle of these, to the right and
    upwards (`angles_around`).
    """
    drawn = Figure(_SIZE, _DPI, layout='constrained')
    axes = drawn.add_subplot()
    places = angles_around(pose, cameras, [each.camera for each in found])
    views = angles_around(pose, cameras, cameras)
    sigmas, now = 1e3 * np.array([each.sigma for each in found]), 1e3 * found[0].now
    _rings(axes, float(np.linalg.norm(np.concatenate([places, views]), axis=1).max()) + _MARGIN)
    blind = sigmas >= now
    axes.scatter(places[blind, 0], places[blind, 1], s=55, facecolors='none', edgecolors='#999999')
    low = float(min(sigmas[0], 0.99 * now))
    dots = axes.scatter(places[~blind, 0], places[~blind, 1], c=sigmas[~blind], s=55,
                        cmap='viridis', norm=LogNorm(low, now))
    axes.plot(*views.T, 'x', color='#555555', markersize=7, label='views there are')
    title = f'{now:.2g} mm now; no view from here is expected to help'
    if not blind[0]:
        axes.scatter(places[0, 0], places[0, 1], s=190, facecolors='none',
                     edgecolors=_RINGED, linewidths=2, label='best')
        title = f'{now:.2g} mm now, {sigmas[0]:.2g} mm with a view from here'
    axes.legend(loc='upper left', frameon=False, fontsize='small')
    axes.set_title(title, fontsize='medium')
    axes.set(xlabel='to the right [degrees]', ylabel='upwards [degrees]')
    bar = drawn.colorbar(dots, label='standard deviation then [mm]')
    bar.set_ticks(_ticks(low, now))
    bar.ax.yaxis.set_major_formatter('{x:g}')
    bar.ax.minorticks_off()
    return drawn


def _rings(axes: Axes, reach: float) -> None:
    """Circles of equal angle, and equal scales."""
    for radius in np.arange(_RING, reach, _RING):
        axes.add_patch(Circle((0, 0), radius, fill=False, edgecolor=_GRID, zorder=0))
    axes.axhline(0, color=_GRID, linewidth=1, zorder=0)
    axes.axvline(0, color=_GRID, linewidth=1, zorder=0)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect='equal')
    axes.spines[['top', 'right']].set_visible(False)


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers between two, for a logarithmic axis."""
    return [tick for power in range(-4, 5) for part in (1, 2, 5)
            if low <= (tick := part * 10.0 ** power) <= high]
