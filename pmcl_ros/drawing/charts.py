"""Draws line charts, and figures of matplotlib as (height, width, 3) uint8 RGB arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from io import BytesIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

# Distinct for colour-blind eyes too (Okabe and Ito).
_COLOURS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#56b4e9', '#e69f00')
_NEUTRAL = '#555555'
_WIDTH, _HEIGHT = 4.4, 3.3  # inches of a chart
_DPI = 100


@dataclass(frozen=True)
class Line:
    """y over x, both (n,). colour counts from 0, -1 is grey; NaN breaks the line."""

    name: str
    x: ArrayLike
    y: ArrayLike
    colour: int = 0
    dashed: bool = False


@dataclass(frozen=True)
class Chart:
    """Lines over a grid. A range may run from a larger number to a smaller one."""

    title: str
    x_name: str
    y_name: str
    lines: Sequence[Line]
    x_range: tuple[float, float]
    y_range: tuple[float, float] = field(default=(0, 100))


def figure(charts: Sequence[Sequence[Chart]], width: float = _WIDTH) -> Figure:
    """Rows of charts; neighbours with the same lines share a legend.

    width: of each [inches], of a hundred pixels each.
    """
    columns = max(len(row) for row in charts)
    drawn = Figure((width * columns + 1.2, _HEIGHT * len(charts)), _DPI, layout='constrained')
    grid = drawn.subplots(len(charts), columns, squeeze=False)
    for row, places in zip(charts, grid, strict=True):
        for number, place in enumerate(places):
            if number >= len(row):
                place.remove()
                continue
            _draw(place, row[number])
            if number + 1 == len(row) or _names(row[number]) != _names(row[number + 1]):
                place.legend(loc='upper left', bbox_to_anchor=(1.02, 1), frameon=False,
                             fontsize='small')
    return drawn


def picture(drawn: Figure) -> NDArray[np.uint8]:
    """A figure as an array."""
    buffer = BytesIO()
    drawn.savefig(buffer, format='rgba')
    width, height = drawn.canvas.get_width_height()
    return np.frombuffer(buffer.getvalue(), np.uint8).reshape(height, width, 4)[..., :3].copy()


def draw(charts: Sequence[Sequence[Chart]], width: float = _WIDTH) -> NDArray[np.uint8]:
    """Rows of charts (`figure`) as an array."""
    return picture(figure(charts, width))


def _draw(axes: Axes, chart: Chart) -> None:
    for each in chart.lines:
        axes.plot(np.asarray(each.x, float), np.asarray(each.y, float), label=each.name,
                  color=_NEUTRAL if each.colour < 0 else _COLOURS[each.colour % len(_COLOURS)],
                  linestyle='--' if each.dashed else '-')
    axes.set(title=chart.title, xlabel=chart.x_name, ylabel=chart.y_name, xlim=chart.x_range,
             ylim=chart.y_range)
    axes.title.set_fontsize('medium')
    axes.grid(color='#dddddd')
    axes.spines[['top', 'right']].set_visible(False)


def _names(chart: Chart) -> list[str]:
    return [each.name for each in chart.lines]
