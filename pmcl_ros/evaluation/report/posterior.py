"""How sure the pose is: its distribution two by two and one by one, and the modes."""

from collections.abc import Iterable
from itertools import combinations
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.markup import element, figure, figures, key, section, table
from pmcl_ros.evaluation.report.plot import Plot, ellipse
from pmcl_ros.pmcl.summary import rotation_distance, tangent

_LEVEL = 0.9
_REACH = 4.0  # standard deviations that are shown on each side
_BINS = 24


class Coordinates(NamedTuple):
    """Deviations from the estimate, in the directions that the symmetry leaves.

    names: (d,) with units. particles: (n, d). covariance: (d, d). truth: (d,), if known. mm, deg.
    """

    names: list[str]
    particles: NDArray[np.float64]
    covariance: NDArray[np.float64]
    truth: NDArray[np.float64] | None

    @property
    def sigma(self) -> NDArray[np.float64]:
        """(d,) standard deviations."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 1e-12))


def coordinates(run: Localization) -> Coordinates:
    """x, y, z [mm] of the camera's frame, then turns [deg].

    With an axis of symmetry these are its tilts in the image's plane (about the line of sight's
    part across it) and towards the camera; without, about x, y and z.
    """
    estimate, axis = run.estimate, run.model.axis
    basis = np.zeros((6, 6 if axis is None else 5))
    basis[:3, :3] = np.eye(3)
    names = ['x [mm]', 'y [mm]', 'z [mm]']
    if axis is None:
        basis[3:, 3:] = np.eye(3)
        names += ['about x [deg]', 'about y [deg]', 'about z [deg]']
    else:
        basis[3:, 3:] = tilts(estimate.pose, axis).T
        names += ['lean in the image [deg]', 'lean to the camera [deg]']
    basis = basis * np.array([1e3] * 3 + [180 / np.pi] * (basis.shape[1] - 3))
    truth = None
    if run.truth is not None and not run.truth.empty:
        truth = tangent(run.truth.pose[None], estimate.pose, axis)[0] @ basis
    return Coordinates(names, tangent(estimate.particles, estimate.pose, axis) @ basis,
                       basis.T @ estimate.covariance @ basis, truth)


def tilts(pose: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, 3) unit turns that lean an axis of symmetry: in the image, and towards the camera."""
    spindle = pose[:3, :3] @ axis
    ray = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    inside = ray - spindle * (spindle @ ray)
    if np.linalg.norm(inside) < 1e-3:  # seen along its axis
        inside = np.array([1.0, 0, 0]) - spindle * spindle[0]
    inside = inside / np.linalg.norm(inside)
    return np.stack([inside, np.cross(spindle, inside)])


def posterior_section(run: Localization) -> Element:
    """Pairs, marginals and modes."""
    found = coordinates(run)
    turns = range(3, len(found.names))
    entries = [('particle', 'particles'), ('blue', f'1 sigma and {100 * _LEVEL:.0f} %'),
               ('estimate', 'estimate')]
    if found.truth is not None:
        entries.append(('truth', 'truth'))
    outside = int((np.abs(found.particles) > _REACH * found.sigma).any(axis=1).sum())
    note = (f'{outside} of {len(found.particles)} particles lie outside the drawings, about '
            'other modes or far from this one.' if outside else None)
    return section(
        'How sure it is', 'posterior', 'Deviations from the estimate, in the frame of the camera: '
        'x right, y down, z away from it. Mind the scales, which differ.', key(*entries),
        figures(*_pairs(found, range(3)), *_marginals(run, found, range(3)),
                *_pairs(found, turns), *_marginals(run, found, turns)),
        element('p', note) if note else None, element('h3', 'Modes'), _modes(run))


def _pairs(found: Coordinates, chosen: Iterable[int]) -> list[Element]:
    return [figure(_pair(found, *each), f'{_short(found, each[0])} and {_short(found, each[1])}.')
            for each in combinations(chosen, 2)]


def _marginals(run: Localization, found: Coordinates, chosen: Iterable[int]) -> list[Element]:
    return [figure(_marginal(found, k, run), f'{_short(found, k)}: standard deviation '
                   f'{found.sigma[k]:.2f} {_unit(found, k)}.') for k in chosen]


def _short(found: Coordinates, k: int) -> str:
    return found.names[k].partition(' [')[0]


def _unit(found: Coordinates, k: int) -> str:
    return found.names[k].partition('[')[2].rstrip(']')


def _pair(found: Coordinates, first: int, second: int) -> Element:
    k = [first, second]
    reach = _REACH * found.sigma[k]
    if found.truth is not None:
        reach = np.maximum(reach, 1.1 * np.abs(found.truth[k]))
    # Depth goes up, away from the camera; y goes down, as in the image.
    up = -1 if second == 1 else 1
    plot = Plot((-reach[0], reach[0]), (-up * reach[1], up * reach[1]), found.names[first],
                found.names[second], size=(340.0, 330.0), title='two coordinates of the pose')
    plot.dots(found.particles[:, first], found.particles[:, second], 'particle')
    covariance = found.covariance[np.ix_(k, k)]
    for radius in (1.0, float(np.sqrt(chi2.ppf(_LEVEL, 2)))):
        plot.path([ellipse(covariance, radius)], 'blue', closed=True)
    plot.dots([0.0], [0.0], 'estimate', 3.5)
    if found.truth is not None:
        plot.dots(found.truth[k[:1]], found.truth[k[1:]], 'truth', 3.5)
    return plot.svg


def _marginal(found: Coordinates, k: int, run: Localization) -> Element:
    sigma = float(found.sigma[k])
    reach = _REACH * sigma
    if found.truth is not None:
        reach = max(reach, 1.1 * abs(float(found.truth[k])))
    edges = np.linspace(-reach, reach, _BINS + 1)
    weights = np.exp(run.estimate.log_weights)
    heights = np.histogram(found.particles[:, k], edges, weights=weights)[0] / np.diff(edges)
    top = 1.15 * max(float(heights.max()), float(norm.pdf(0, scale=sigma)))
    plot = Plot((-reach, reach), (0, top), found.names[k], 'density', size=(340.0, 170.0),
                y_ticks=[], title='one coordinate of the pose')
    plot.bars(edges, heights, 'area')
    fine = np.linspace(-reach, reach, 121)
    plot.line(fine, norm.pdf(fine, scale=sigma), 'blue')
    plot.line([0.0, 0.0], [0.0, top], 'estimate')
    if found.truth is not None:
        plot.line([found.truth[k]] * 2, [0.0, top], 'truth')
    return plot.svg


def _modes(run: Localization) -> Element:
    if not run.estimate.modes:
        return element('p', 'This mode of the search compares none.')
    rows = []
    for each in run.estimate.modes:
        off = np.linalg.norm(each.pose[:3, 3] - run.estimate.pose[:3, 3])
        turned = rotation_distance(each.pose[None], run.estimate.pose, run.model.axis)[0]
        x, y, z = 1e3 * each.pose[:3, 3]
        rows.append([f'{x:.1f}, {y:.1f}, {z:.1f}', f'{100 * each.weight:.1f} %',
                     f'{each.score:.1f}', f'{1e3 * off:.1f}', f'{np.rad2deg(turned):.1f}'])
    return table(['position [mm]', 'weight', 'evidence [nat]', 'from the estimate [mm]',
                  'turned [deg]'], rows)
