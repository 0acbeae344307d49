"""matplotlib's drawings as SVG within a page, in the colours of the page's style sheet."""

import re
from collections.abc import Iterable, Sequence
from io import StringIO

import numpy as np
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import ArrayLike, NDArray

_WIDTH = 340.0  # px of a narrow drawing: about the width of a phone
_MARGINS = 46.0, 10.0, 8.0, 36.0  # px: left, right, top and bottom of the axes
_DPI = 72  # matplotlib's SVG has a unit of 1/72 inch: a pixel is such a unit

# The variables of page.css. matplotlib takes no CSS: `svg` replaces these stand-ins.
_STAND_INS = {name: f'#{0x3fa500 + number:06x}' for number, name in enumerate((
    'ink', 'soft', 'line', 'blue', 'orange', 'sky', 'estimate', 'truth', 'particle',
    'on-estimate', 'on-truth', 'on-particle', 'front', 'back', 'rim', 'axis-x', 'axis-y',
    'axis-z', 'for', 'rather-for', 'rather-against', 'against'))}

Range = tuple[float, float]


def axes(x: Range, y: Range, x_name: str = '', y_name: str = '', *,
         size: tuple[float, float] = (_WIDTH, 240.0), picture: NDArray[np.uint8] | None = None,
         framed: bool = True) -> Axes:
    """Axes of their own figure. A range may run from a larger number to a smaller one.

    size: width and height of the figure [px]. picture: fills the axes, (height, width[, 3]).
    framed: with ticks and names; without, the axes fill the figure.
    """
    width, height = size
    left, right, top, bottom = _MARGINS if framed else (0.0,) * 4
    figure = Figure((width / _DPI, height / _DPI), _DPI)
    made = figure.add_axes((left / width, bottom / height, 1 - (left + right) / width,
                            1 - (top + bottom) / height))
    if picture is not None:
        made.imshow(picture, 'gray', vmin=0, vmax=255, extent=(*x, *y), aspect='auto',
                    interpolation='none')
    made.set(xlim=x, ylim=y, frame_on=framed)
    if not framed:
        made.set(xticks=[], yticks=[])
        return made
    made.set_xlabel(x_name, color=colour('ink'), size=12, labelpad=3)
    # Anchored: browsers set texts in other fonts than the one that matplotlib measures.
    made.set_ylabel(y_name, color=colour('ink'), size=12, rotation_mode='anchor', ha='center')
    made.yaxis.set_label_coords(14 / _DPI, (bottom + (height - top)) / 2 / _DPI,
                                figure.dpi_scale_trans)
    made.locator_params(nbins=6, steps=[1, 2, 5, 10])
    made.tick_params(labelsize=11, color=colour('line'), labelcolor=colour('soft'),
                     length=4 if picture is not None else 0)
    if picture is None:
        made.grid(color=colour('line'), linewidth=1)
        made.set_axisbelow(True)
    for spine in made.spines.values():
        spine.set(edgecolor=colour('soft'), linewidth=1)
    return made


def over(picture: NDArray[np.uint8], window: Sequence[int] | None = None) -> Axes:
    """A picture (height, width[, 3]) to draw upon, in its own pixels.

    window: left, top, width, height of the part that is shown [px].
    """
    left, top, width, height = window or (0, 0, picture.shape[1], picture.shape[0])
    return axes((left - 0.5, left + width - 0.5), (top + height - 0.5, top - 0.5), framed=False,
                size=(_WIDTH, _WIDTH * height / width),
                picture=picture[top:top + height, left:left + width])


def colour(name: str) -> str:
    """The stand-in of a variable of the style sheet."""
    return _STAND_INS[name]


def lines(made: Axes, pieces: Iterable[NDArray[np.floating]], name: str, width: float = 1.6,
          dash: tuple[float, float] | None = None) -> None:
    """Polylines (n, 2) in data coordinates, as one element."""
    pieces = [each for each in pieces if len(each)]
    if not pieces:
        return
    codes = np.concatenate([[Path.MOVETO, *[Path.LINETO] * (len(each) - 1)] for each in pieces])
    path = Path(np.concatenate(pieces), codes)
    path.should_simplify = False  # it would drop the dots
    made.add_patch(PathPatch(path, fill=False, edgecolor=colour(name), linewidth=width,
                             capstyle='round', joinstyle='round',
                             linestyle=(0, dash) if dash else 'solid'))


def outline(made: Axes, pieces: Iterable[NDArray[np.floating]], name: str,
            dash: tuple[float, float] | None = None) -> None:
    """Closed polylines (n, 2) in data coordinates."""
    lines(made, [np.concatenate([each, each[:1]]) for each in pieces], name, 2.0, dash)


def dots(made: Axes, points: ArrayLike, name: str, radius: float = 1.6) -> None:
    """A dot for each of the points (n, 2).

    Lines of no length with round ends take a tenth of the text of circles.
    """
    lines(made, np.repeat(np.reshape(points, (-1, 1, 2)), 2, axis=1), name, 2 * radius)


def svg(made: Axes, title: str) -> Markup:
    """The figure as an element of a page. title: for who cannot see it; unique in the page."""
    stream, figure = StringIO(), made.figure
    assert isinstance(figure, Figure)
    with rc_context({'svg.fonttype': 'none', 'svg.hashsalt': title}):
        figure.savefig(stream, format='svg', transparent=True, metadata=dict.fromkeys(
            ('Creator', 'Date', 'Format', 'Type')))
    _, _, text = stream.getvalue().partition('viewBox="')
    box, _, text = text.partition('"')
    text = re.sub('<g id=".*?"', '<g', text[text.index('<defs>'):])
    text = re.sub(r' d="[^"]*"', lambda path: re.sub(r'(\.\d\d)\d+', r'\1', path[0]), text)
    for name, stand_in in _STAND_INS.items():
        text = text.replace(stand_in, f'var(--{name})')
    return Markup('<svg class="plot" role="img" viewBox="{}"><title>{}</title>').format(
        box, title) + Markup(text)
