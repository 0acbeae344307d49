"""Drawings of the posterior: pairs of coordinates, and marginals."""

from itertools import combinations

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from pmcl_ros.evaluation.report.html import Figure
from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.posterior import Coordinates
from pmcl_ros.evaluation.report.svg import axes, colour, dots, lines, svg

LEVEL = 0.9  # of the credible regions
REACH = 4.0  # standard deviations that are shown on each side
_BINS = 24  # of a histogram


def posterior_figures(run: Localization, found: Coordinates) -> list[Figure]:
    """Positions, then turns: each two by two, then one by one."""
    figures = []
    for chosen in (range(3), range(3, len(found.names))):
        figures += [Figure(_pair(found, *each), f'{found.names[each[0]]} and '
                           f'{found.names[each[1]]}.') for each in combinations(chosen, 2)]
        figures += [Figure(_marginal(found, k, run), f'{found.names[k]}: standard deviation '
                           f'{found.sigma[k]:.2f} {found.units[k]}.') for k in chosen]
    return figures


def _pair(found: Coordinates, first: int, second: int) -> Markup:
    k = [first, second]
    reach = REACH * found.sigma[k]
    if found.truth is not None:
        reach = np.maximum(reach, 1.1 * np.abs(found.truth[k]))
    # Depth goes up, away from the camera; y goes down, as in the image.
    up = -1 if second == 1 else 1
    made = axes((-reach[0], reach[0]), (-up * reach[1], up * reach[1]), _name(found, first),
                _name(found, second), size=(340.0, 330.0))
    dots(made, found.particles[:, k], 'particle')
    covariance = found.covariance[np.ix_(k, k)]
    lines(made, [ellipse(covariance, radius) for radius in (
        1.0, float(np.sqrt(chi2.ppf(LEVEL, 2))))], 'blue')
    dots(made, np.zeros(2), 'estimate', 3.5)
    if found.truth is not None:
        dots(made, found.truth[k], 'truth', 3.5)
    return svg(made, f'{found.names[first]} and {found.names[second]} of the pose')


def _marginal(found: Coordinates, k: int, run: Localization) -> Markup:
    sigma = float(found.sigma[k])
    truth = None if found.truth is None else float(found.truth[k])
    reach = max(REACH * sigma, 1.1 * abs(truth or 0))
    edges = np.linspace(-reach, reach, _BINS + 1)
    weights = np.exp(run.estimate.log_weights)
    heights = np.histogram(found.particles[:, k], edges, weights=weights)[0] / np.diff(edges)
    top = 1.15 * max(float(heights.max()), float(norm.pdf(0, scale=sigma)))
    made = axes((-reach, reach), (0, top), _name(found, k), 'density', size=(340.0, 170.0))
    made.set_yticks([])
    made.stairs(heights, edges, fill=True, color=colour('sky'), alpha=0.35)
    fine = np.linspace(-reach, reach, 121)
    lines(made, [np.stack([fine, norm.pdf(fine, scale=sigma)], axis=1)], 'blue')
    lines(made, [np.array([[0, 0], [0, top]])], 'estimate', 2.0)
    if truth is not None:
        lines(made, [np.array([[truth, 0], [truth, top]])], 'truth', dash=(2, 4))
    return svg(made, f'{found.names[k]} of the pose')


def _name(found: Coordinates, k: int) -> str:
    return f'{found.names[k]} [{found.units[k]}]'


def ellipse(covariance: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """(n, 2) where a Gaussian of covariance (2, 2) is `radius` standard deviations away."""
    angle = np.linspace(0, 2 * np.pi, 73)
    values, vectors = np.linalg.eigh(covariance)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return (vectors * np.sqrt(np.maximum(values, 0)) @ circle * radius).T
