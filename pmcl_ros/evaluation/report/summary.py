"""The beginning and the end of a report: the verdict; times, settings and versions."""

from datetime import datetime, timezone
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from pmcl_ros.evaluation.errors import pose_error
from pmcl_ros.evaluation.report.localization import Localization, versions
from pmcl_ros.evaluation.report.markup import Node, element, section, table
from pmcl_ros.evaluation.report.posterior import coordinates
from pmcl_ros.evaluation.report.search import NAMES
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.pmcl.summary import credible_level
from pmcl_ros.runtime.settings import Settings

_NOT_TOLD = 'not told'


class Fact(NamedTuple):
    """A line of the verdict. name: for who reads the page by machine."""

    name: str
    title: str
    value: str
    note: str = ''


def verdict(run: Localization) -> Element:
    """What was found, how sure that is, how far off."""
    words = 'Lost' if run.estimate.lost else 'Found'
    told = ('The picture does not support that the object is there. What follows is the best '
            'hypothesis.' if run.estimate.lost else None)
    facts = [*_pose(run), *_sureness(run), *_truth(run)]
    return element(
        'section', element('p', element('strong', words, class_='lost' if run.estimate.lost
                                        else 'found', id='verdict'), ' ', run.model.name,
                           class_='verdict'),
        element('p', told) if told else None,
        element('dl', *(element('div', element('dt', each.title),
                                element('dd', element('b', each.value, id=each.name), ' ',
                                        element('span', each.note))) for each in facts)))


def about(run: Localization) -> Element:
    """Which picture it is."""
    header, grid = run.estimate.header, run.light_field.grid
    rows, columns = grid.shape
    taken = _NOT_TOLD
    if header.stamp_ns:
        # To the microsecond: no float holds more, and no shutter.
        moment = datetime.fromtimestamp(header.stamp_ns // 10**9, timezone.utc)
        taken = f'{moment:%Y-%m-%d %H:%M:%S}.{header.stamp_ns % 10**9 // 1000:06d} UTC'
    told = [('picture', run.source or _NOT_TOLD), ('taken', taken),
            ('camera', run.serial or _NOT_TOLD), ('frame', header.frame_id),
            ('views', f'{rows} x {columns} of {grid.pinhole.width} x {grid.pinhole.height} px, '
             f'{1e3 * grid.baseline:.3f} mm apart')]
    return element('p', *(part for name, value in told for part in (
        element('span', element('i', f'{name} '), value), ' ')), class_='about')


def _pose(run: Localization) -> list[Fact]:
    estimate, found = run.estimate, coordinates(run)
    facts = [Fact(name, name, f'{1e3 * value:.1f} mm', f'±\u00a0{_short(sigma)}\u00a0mm')
             for name, value, sigma in zip('xyz', estimate.pose[:3, 3], found.sigma[:3],
                                           strict=True)]
    if run.model.axis is not None:
        along = estimate.pose[:3, :3] @ run.model.axis
        facts.append(Fact('axis', 'axis', ', '.join(f'{each:+.3f}' for each in along),
                          f'±\u00a0{_short(np.sqrt((found.sigma[3:] ** 2).mean()))}°'))
    else:
        facts.append(Fact('orientation', 'orientation', ', '.join(
            f'{each:+.4f}' for each in estimate.quaternion), 'x, y, z, w; ± '
            + ', '.join(_short(each) for each in found.sigma[3:]) + '° about x, y, z'))
    return facts


def _sureness(run: Localization) -> list[Fact]:
    estimate = run.estimate
    if not estimate.modes:
        return [Fact('score', 'mean likelihood', f'{estimate.score:.4g}')]
    facts = [Fact('weight', 'weight of this mode', f'{100 * estimate.modes[0].weight:.0f} %',
                  f'of {len(estimate.modes)} compared')]
    if run.contour is not None and len(run.contour.lengths):
        length = float(run.contour.lengths.sum())
        facts.append(Fact('score', 'evidence', f'{estimate.score:.0f} nat',
                          f'over {length:.0f} px of contour'))
    facts.append(Fact('whole', 'whole contour', f'{estimate.evidence:+.2f} nat/px',
                      f'lost below {ContourProfile.learned().least:+.2f}'))
    facts.append(Fact('support', 'weakest fifth', f'{estimate.support:+.2f} nat/px',
                      f'lost below {run.settings.least_support:+.2f}'))
    return facts


def _truth(run: Localization) -> list[Fact]:
    if run.truth is None:
        return []
    if run.truth.empty:
        return [Fact('error', 'truth', 'the object is not there')]
    error = pose_error(run.estimate.pose, run.truth.pose, run.model.axis)
    level = credible_level(run.truth.pose, run.estimate.pose, run.estimate.covariance,
                           run.model.axis)
    return [Fact('error', 'off the truth by', f'{1e3 * error.translation:.1f} mm, '
                 f'{np.rad2deg(error.rotation):.1f}°',
                 f'{1e3 * error.ray:+.1f} mm along the line of sight'),
            Fact('level', 'credible region with the truth', f'{100 * level:.0f} %')]


def _short(sigma: float) -> str:
    return f'{sigma:.2f}' if sigma < 1 else f'{sigma:.1f}'


def times_section(run: Localization) -> Element:
    """Wall time of each stage, drawn to scale."""
    names = {'views': 'views, from the picture', 'volume': 'volume and edges',
             'estimate': 'summary of the posterior', **NAMES}
    longest = max(*run.seconds.values(), 1e-9)
    rows: list[list[Node]] = [
        [names.get(name, name), f'{1e3 * each:.0f}',
         element('i', class_='bar', style=f'width: {max(100 * each / longest, 0.5):.1f}%')]
        for name, each in run.seconds.items()]
    return section('Time', 'time', f'{sum(run.seconds.values()):.2f} s in all.',
                   table(['stage', 'ms', ''], rows),
                   'Wall time of this run, the first in its process. Poses were scored by '
                   f'{run.renderer}.')


def settings_section(run: Localization) -> Element:
    """All settings, what differs from the defaults marked, and versions."""
    parts: list[Node] = []
    for name, settings in (('Search', run.settings), ('Volume', run.volume_settings)):
        parts += [element('h3', name), table(['parameter', 'value', 'default'], _rows(settings),
                                             numbers=False)]
    parts += [element('h3', 'Versions'), table(['', ''], [list(each) for each in
                                                         versions().items()], numbers=False)]
    return section('Made with', 'settings', element('details', element(
        'summary', 'settings and versions'), *parts))


def _rows(settings: Settings) -> list[list[Node]]:
    rows: list[list[Node]] = []
    for name, field in type(settings).model_fields.items():
        value = getattr(settings, name)
        same = value == field.default
        rows.append([name, f'{value}' if same else element('b', f'{value}'),
                     '' if same else f'{field.default}'])
    return rows
