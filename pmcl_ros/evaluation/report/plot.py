"""Drawings in SVG: axes, lines, dots and areas over an optional picture, in data coordinates.

Colours are classes of the page's style sheet, so that they follow its light and dark scheme.
"""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from pmcl_ros.evaluation.report.markup import data_uri, element

_WIDTH = 340.0  # of a narrow drawing: about that of a phone, where a unit is a pixel
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 10.0, 8.0, 36.0  # around the axes

Range = tuple[float, float]
Ticks = Sequence[tuple[float, str]]


class Plot:
    """A drawing of x over y; a range may run from a larger number to a smaller one.

    size: width and height of the drawing. picture: fills the axes, (height, width[, 3]) uint8.
    log: the ordinate is logarithmic. ticks: (value, text) instead of round numbers; empty: none.
    frame: with axes and ticks; without, the drawing is the picture alone.
    """

    def __init__(self, x: Range, y: Range, x_name: str = '', y_name: str = '', *,
                 size: tuple[float, float] = (_WIDTH, 240.0), title: str = '',
                 picture: NDArray[np.uint8] | None = None, log: bool = False,
                 x_ticks: Ticks | None = None, y_ticks: Ticks | None = None,
                 frame: bool = True) -> None:
        self._x, self._log = x, log
        self._y = (float(np.log10(y[0])), float(np.log10(y[1]))) if log else y
        width, height = size
        self._left, self._top = (_LEFT, _TOP) if frame else (0.0, 0.0)
        self._across = width - (_LEFT + _RIGHT if frame else 0)
        self._down = height - (_TOP + _BOTTOM if frame else 0)
        self.svg = element('svg', element('title', title), viewBox=f'0 0 {width:g} {height:g}',
                           class_='plot', role='img')
        if picture is not None:
            self.svg.append(element(
                'image', href=data_uri(picture), x=self._left, y=self._top, width=self._across,
                height=self._down, preserveAspectRatio='none'))
        if frame:
            self._axes(x_name, y_name, x_ticks, y_ticks, picture is not None)
        # What is drawn ends at the axes.
        self._marks = element('svg', x=self._left, y=self._top, width=self._across,
                              height=self._down, overflow='hidden')
        self.svg.append(self._marks)

    def place(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """(n, 2) in the drawing, from the axes' upper left corner."""
        y = np.log10(np.asarray(y, float)) if self._log else np.asarray(y, float)
        across = (np.asarray(x, float) - self._x[0]) / (self._x[1] - self._x[0])
        down = (self._y[1] - y) / (self._y[1] - self._y[0])
        return np.stack(np.broadcast_arrays(across * self._across, down * self._down), axis=-1)

    def line(self, x: ArrayLike, y: ArrayLike, kind: str) -> None:
        """A polyline; NaN breaks it."""
        self.path([np.stack(np.broadcast_arrays(np.asarray(x, float), y), axis=-1)], kind)

    def path(self, lines: Sequence[NDArray[np.floating]], kind: str, closed: bool = False) -> None:
        """Polylines (n, 2) in data coordinates."""
        text = ''.join(self._steps(self.place(each[:, 0], each[:, 1]), closed) for each in lines)
        if text:
            self._marks.append(element('path', d=text, class_=kind))

    def dots(self, x: ArrayLike, y: ArrayLike, kind: str, radius: float = 1.6) -> None:
        """A dot for each point."""
        ends = [np.array([point, point]) for point in self.place(x, y)]
        text = ''.join(self._steps(each, False) for each in ends)
        # Lines of no length with round ends: a tenth of what circles take.
        if text:
            self._marks.append(element('path', d=text, class_=f'dots {kind}',
                                       style=f'stroke-width: {2 * radius:g}'))

    def bars(self, edges: ArrayLike, heights: ArrayLike, kind: str) -> None:
        """A histogram: (n + 1,) edges, (n,) heights, from zero up."""
        edges, heights = np.repeat(np.asarray(edges, float), 2), np.repeat(heights, 2)
        self.path([np.stack([edges, np.concatenate([[0], heights, [0]])], axis=-1)], kind)

    def text(self, x: float, y: float, words: str, kind: str = 'label',
             anchor: str = 'middle') -> None:
        """Words at a point."""
        across, down = self.place(x, y)
        self._marks.append(element('text', words, x=float(across), y=float(down), class_=kind,
                                   text_anchor=anchor))

    def _steps(self, points: NDArray[np.float64], closed: bool) -> str:
        text, drawing = '', False
        for x, y in points:
            known = bool(np.isfinite(x) and np.isfinite(y))
            if known:
                text += f'{"L" if drawing else "M"}{x:.2f} {y:.2f}'
            drawing = known
        return text + ('Z' if closed and text else '')

    def _axes(self, x_name: str, y_name: str, x_ticks: Ticks | None, y_ticks: Ticks | None,
              covered: bool) -> None:
        if x_ticks is None:
            x_ticks = _ticks(*self._x)
        if y_ticks is None:
            y_ticks = _decades(*self._y) if self._log else _ticks(*self._y)
        bottom, right = self._top + self._down, self._left + self._across
        for value, text in x_ticks:
            x = self._left + (value - self._x[0]) / (self._x[1] - self._x[0]) * self._across
            self._tick((x, bottom, x, bottom + 4 if covered else self._top),
                       element('text', text, x=x, y=bottom + 15, text_anchor='middle'))
        for value, text in y_ticks:
            y = self._top + (self._y[1] - value) / (self._y[1] - self._y[0]) * self._down
            self._tick((self._left, y, self._left - 4 if covered else right, y),
                       element('text', text, x=self._left - 6, y=y + 4, text_anchor='end'))
        self.svg.append(element('rect', x=self._left, y=self._top, width=self._across,
                                height=self._down, class_='frame'))
        middle = self._top + self._down / 2
        self.svg.append(element('text', x_name, x=self._left + self._across / 2, y=bottom + 31,
                                text_anchor='middle', class_='name'))
        self.svg.append(element('text', y_name, x=11.0, y=middle, text_anchor='middle',
                                class_='name', transform=f'rotate(-90 11 {middle:.2f})'))

    def _tick(self, ends: tuple[float, float, float, float], text: Element) -> None:
        x, y, u, v = ends
        self.svg.append(element('line', x1=x, y1=y, x2=u, y2=v, class_='grid'))
        text.set('class', 'tick')
        self.svg.append(text)


def ellipse(covariance: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """(n, 2) where a Gaussian of covariance (2, 2) is `radius` standard deviations away."""
    angle = np.linspace(0, 2 * np.pi, 73)
    values, vectors = np.linalg.eigh(covariance)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return (vectors * np.sqrt(np.maximum(values, 0)) @ circle * radius).T


def round_numbers(low: float, high: float) -> NDArray[np.float64]:
    """About five of them, from `low` to `high`."""
    values = np.round(MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(low, high), 12) + 0.0
    return values[(values >= low - 1e-9 * (high - low)) & (values <= high + 1e-9 * (high - low))]


def _ticks(low: float, high: float) -> Ticks:
    values = round_numbers(min(low, high), max(low, high))
    return [(float(value), f'{value:g}') for value in values]


def _decades(low: float, high: float) -> Ticks:
    exponents = range(int(np.ceil(low - 1e-9)), int(np.floor(high + 1e-9)) + 1)
    return [(float(each), f'{10.0 ** each:g}') for each in exponents]
