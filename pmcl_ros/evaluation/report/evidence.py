"""What speaks for the pose and against it, along the object's contour."""

from xml.etree.ElementTree import Element

import numpy as np

from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.markup import figure, figures, key, section
from pmcl_ros.evaluation.report.plot import Plot
from pmcl_ros.evaluation.report.views import over
from pmcl_ros.pmcl.render.contour_points import ContourPoints

# nat / px: where one class of colour ends and the next begins.
_BOUNDS = (-1.0, 0.0, 1.0)
_KINDS = ('against', 'rather-against', 'rather-for', 'for')
_ARC = 8.0  # px of the contour that one value of the chart is the mean of


def evidence_section(run: Localization) -> Element:
    """The contour in the picture, coloured, and unrolled."""
    points = run.contour
    if points is None or not len(points.lengths):
        return section('What it rests on', 'evidence', 'This mode of the search looks at no '
                       'contour.' if points is None else 'No contour is in view.')
    length = float(points.lengths.sum())
    supporting = float(points.lengths[points.evidence > 0].sum() / length)
    entries = (('for', 'more than 1 nat/px for it'), ('rather-for', 'for it'),
               ('rather-against', 'against it'), ('against', 'more than 1 nat/px against it'))
    return section(
        'What it rests on', 'evidence',
        f'{length:.0f} px of contour, {100 * supporting:.0f} % of which speak for the pose; in '
        f'all {float(points.lengths @ points.evidence):.0f} nat.', key(*entries),
        figures(figure(_coloured(run, points), 'The contour where its evidence is measured: at '
                       'its own depth in the views refocused there.'),
                figure(_unrolled(run, points), 'The same unrolled, piece by piece, means over '
                       f'{_ARC:.0f} px. Dashed: what the weakest fifth has to reach.')))


def classes(points: ContourPoints) -> list[str]:
    """The class of colour of each point."""
    return [_KINDS[k] for k in np.searchsorted(_BOUNDS, points.evidence, side='right')]


def _coloured(run: Localization, points: ContourPoints) -> Element:
    pinhole = run.light_field.grid.pinhole
    window = run.region.window(pinhole, run.model.radius)
    plot = over(run.light_field.picture(), (window.left, window.top, *window.size),
                'evidence along the contour')
    kinds = np.array(classes(points))
    for kind in _KINDS:
        x, y = points.pixels[kinds == kind].T
        plot.dots(x, y, kind, 1.6)
    return plot.svg


def _unrolled(run: Localization, points: ContourPoints) -> Element:
    arcs = np.stack([points.piece, (points.along / _ARC).astype(np.int64)], axis=1)
    first, number = np.unique(arcs, axis=0, return_index=True, return_inverse=True)[1:]
    number = number.ravel()
    lengths = np.bincount(number, points.lengths)
    means = np.bincount(number, points.lengths * points.evidence) / lengths
    place = np.cumsum(lengths) - lengths / 2
    new = np.flatnonzero(np.diff(points.piece[first])) + 1
    x, y = np.insert(place, new, np.nan), np.insert(means, new, np.nan)
    least = run.settings.least_support
    low = min(float(means.min()), least, -0.5) - 0.2
    high = max(float(means.max()), 0.5) + 0.2
    plot = Plot((0, float(lengths.sum())), (low, high), 'along the contour [px]',
                'evidence [nat/px]', title='evidence, unrolled')
    plot.line([0, float(lengths.sum())], [0, 0], 'border')
    plot.line([0, float(lengths.sum())], [least, least], 'border dashed')
    plot.line(x, y, 'blue')
    return plot.svg
