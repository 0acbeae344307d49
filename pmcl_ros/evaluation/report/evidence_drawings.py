"""Drawings of the evidence along a contour."""

import numpy as np

from pmcl_ros.drawing.pictures import displayed
from pmcl_ros.evaluation.report.html import Figure
from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.svg import axes, dots, lines, over, svg
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.pmcl.render.contour_points import ContourPoints

ARC = 8.0  # px of the contour that one value of the chart is the mean of
# nat / px: where one class of colour ends and the next begins.
_BOUNDS = (-1.0, 0.0, 1.0)
_KINDS = ('against', 'rather-against', 'rather-for', 'for')
_THIN = 0.8  # px


def evidence_classes(points: ContourPoints) -> list[str]:
    """The class of colour of each point: 'for', 'rather-for', 'rather-against' or 'against'."""
    return [_KINDS[k] for k in np.searchsorted(_BOUNDS, points.evidence, side='right')]


def evidence_figures(run: Localization, points: ContourPoints) -> list[Figure]:
    """The contour in the picture, coloured by its evidence, and unrolled."""
    window = run.region.window(run.source.pinhole, run.model.radius)
    coloured = over(displayed(run.source), (window.left, window.top, *window.size))
    classes = np.array(evidence_classes(points))
    for name in _KINDS:
        dots(coloured, points.pixels[classes == name], name)
    arcs = np.stack([points.piece, (points.along / ARC).astype(np.int64)], axis=1)
    first, number = np.unique(arcs, axis=0, return_index=True, return_inverse=True)[1:]
    number = number.ravel()
    lengths = np.bincount(number, points.lengths)
    means = np.bincount(number, points.lengths * points.evidence) / lengths
    place = np.cumsum(lengths) - lengths / 2
    new_pieces = np.flatnonzero(np.diff(points.piece[first])) + 1
    least, length = run.estimate.least_support, float(lengths.sum())
    unrolled = axes((0, length), (min(float(means.min()), least, -0.5) - 0.2,
                                  max(float(means.max()), 0.5) + 0.2),
                    'along the contour [px]', 'evidence [nat/px]')
    lines(unrolled, [np.array([[0, 0], [length, 0]])], 'soft', _THIN)
    lines(unrolled, [np.array([[0, least], [length, least]])], 'soft', _THIN, (4, 3))
    lines(unrolled, np.split(np.stack([place, means], axis=1), new_pieces), 'blue')
    return [
        Figure(svg(coloured, 'evidence along the contour'), 'The contour where its evidence is '
               'measured' + (': at its own depth, in the views refocused there.'
                             if isinstance(run.source, LightField) else '.')),
        Figure(svg(unrolled, 'evidence, unrolled'), 'The same unrolled, piece by piece: means '
               f'over {ARC:.0f} px. Dashed: the value that the weakest fifth has to reach.')]
