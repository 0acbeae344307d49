"""The report of a localisation as one HTML page that loads nothing from outside."""

import platform
from datetime import datetime, timezone
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmcl_ros import __version__
from pmcl_ros.drawing.charts import picture
from pmcl_ros.drawing.pictures import layers_picture
from pmcl_ros.drawing.views_picture import next_views_figure, sigmas_figure
from pmcl_ros.evaluation.records import libraries
from pmcl_ros.evaluation.report import (
    evidence_drawings,
    posterior_drawings,
    search_drawings,
    view_drawings,
    volume_drawings,
)
from pmcl_ros.evaluation.report.html import image, rendered
from pmcl_ros.evaluation.report.localization import Localization
from pmcl_ros.evaluation.report.posterior import Coordinates, coordinates
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.pmcl.history import Stage
from pmcl_ros.runtime.settings import Settings, default_of

_UNKNOWN = 'unknown'
_STAGES = {
    'views': 'views, from the picture', 'estimate': 'summary of the posterior',
    'proposals': 'proposals', 'coarse': 'refined, by coarse contours',
    'fine': 'the best, by fine contours', 'ambiguous': 'with ambiguous poses',
    'scattered': 'restarted around them', 'sharpened': 'refined with all pixels',
    'modes': 'modes, refined',
    'approximate': 'posterior, approximated', 'posterior': 'posterior',
    'filter': 'particle filter'}
_MAPPED: tuple[Stage, ...] = ('proposals', 'coarse', 'posterior', 'filter')
# that the template calls
_DRAWINGS = {'view_drawings': view_drawings, 'posterior_drawings': posterior_drawings,
             'evidence_drawings': evidence_drawings, 'volume_drawings': volume_drawings,
             'search_drawings': search_drawings}


class Fact(NamedTuple):
    """A line of the verdict. name: the element's id, for programs that read the page."""

    name: str
    title: str
    value: str
    note: str = ''


def page(run: Localization) -> str:
    """The text of the HTML file."""
    found = coordinates(run)
    outside = (np.abs(found.particles) > posterior_drawings.REACH * found.sigma).any(axis=1)
    return rendered(
        'page.html', run=run, **_DRAWINGS, stages=_STAGES, image=image, **_charts(run),
        known=run.truth is not None and not run.truth.empty, about=about(run),
        facts=[*_pose(run, found), *_sureness(run), *_truth(run)],
        overlays=view_drawings.all_views(run),
        posterior=posterior_drawings.posterior_figures(run, found), outside=int(outside.sum()),
        light_field=run.source if isinstance(run.source, LightField) else None,
        layers=_layers(run),
        maps=[each for stage in _MAPPED
              if (each := search_drawings.stage_map(run, stage, _STAGES[stage])) is not None],
        modes=_modes(run), search=_search(run),
        settings={'Search': _rows(run.settings), 'Volume': _rows(run.volume_settings)},
        versions={'pmcl_ros': __version__, 'Python': platform.python_version(), **libraries()})


def _charts(run: Localization) -> dict[str, NDArray[np.uint8] | None]:
    """Of several views: how the posterior shrinks, and where to look next."""
    shrinking = None if run.sigmas is None else picture(sigmas_figure(run.sigmas))
    further = (picture(next_views_figure(run.next_views, run.in_reference.pose, run.cameras))
               if run.next_views else None)
    return {'shrinking': shrinking, 'further': further}


def _layers(run: Localization) -> NDArray[np.uint8] | None:
    """The front surface of each ray and the next one behind it; None without a volume."""
    of = run.volume_settings
    return None if run.volume is None else layers_picture(run.volume.layers(), of.near, of.far)


def about(run: Localization) -> dict[str, str]:
    """Names and values that say which picture it is."""
    header, pinhole = run.estimate.header, run.source.pinhole
    views = f'{pinhole.width} x {pinhole.height} px'
    if isinstance(run.source, LightField):
        grid = run.source.grid
        rows, columns = grid.shape
        views = f'{rows} x {columns} of {views}, {1e3 * grid.baseline:.3f} mm apart'
    taken = _UNKNOWN
    if header.stamp_ns:
        # To the microsecond: no float holds more, and no shutter.
        moment = datetime.fromtimestamp(header.stamp_ns // 10**9, timezone.utc)
        taken = f'{moment:%Y-%m-%d %H:%M:%S}.{header.stamp_ns % 10**9 // 1000:06d} UTC'
    frame = header.frame_id
    if run.views:
        views = f'{len(run.views)} of {views}; figures are of the first that sees the region'
        frame = f'{frame}; x, y, z and the axis are in that of this first camera'
    return {'picture': run.name or _UNKNOWN, 'taken': taken, 'camera': run.serial or _UNKNOWN,
            'frame': frame, 'views': views}


def _pose(run: Localization, found: Coordinates) -> list[Fact]:
    estimate = run.estimate
    facts = [Fact(name, name, f'{1e3 * value:.1f} mm', f'±\u00a0{_short(sigma)}\u00a0mm')
             for name, value, sigma in zip('xyz', estimate.pose[:3, 3], found.sigma[:3],
                                           strict=True)]
    if run.model.axis is not None:
        along = estimate.pose[:3, :3] @ run.model.axis
        facts.append(Fact('axis', 'axis', ', '.join(f'{each:+.3f}' for each in along),
                          f'±\u00a0{_short(np.sqrt((found.sigma[3:] ** 2).mean()))}°'))
    if run.views:
        place = ', '.join(f'{1e3 * each:.1f}' for each in run.in_reference.pose[:3, 3])
        facts.append(Fact('reference', f'in {run.in_reference.header.frame_id}', f'{place} mm',
                          'x, y, z; the other values are in the frame of the first camera'))
    if run.model.axis is None:
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
                      f'lost below {estimate.least_evidence:+.2f}'))
    facts.append(Fact('support', 'weakest fifth', f'{estimate.support:+.2f} nat/px',
                      f'lost below {estimate.least_support:+.2f}'))
    if np.isfinite(estimate.disagreement):
        facts.append(Fact('disagreement', 'the views disagree by', f'{estimate.disagreement:.2f}',
                          'of what is expected (median square); the weakest fifth has to reach '
                          'more where it is larger'))
    if np.isfinite(estimate.beyond):
        facts.append(Fact('beyond', 'evidence beyond', f'{estimate.beyond:.2f} nat/px',
                          'for other contours than these; the weakest fifth has to reach more '
                          'where it is larger'))
    if estimate.camera_scale and not estimate.lost:
        error, sigma = 100 * estimate.camera_scale.error, 100 * estimate.camera_scale.sigma
        facts.append(Fact('scale', 'camera scale error', f'{error:+.1f} ± {sigma:.1f} %',
                          'with cameras so much farther apart the views fit best'))
    if estimate.evidence_of:
        facts.append(Fact('evidence_of', 'numbers of the', estimate.evidence_of,
                          'edges lose the object or are unsure of it; these numbers are of '
                          'other evidence'))
    if estimate.hidden:
        facts.append(Fact('hidden', 'views not used', ', '.join(map(str, estimate.hidden)),
                          'they do not show it there'))
    return facts


def _truth(run: Localization) -> list[Fact]:
    if run.truth is None:
        return []
    if run.truth.empty:
        return [Fact('error', 'truth', 'the object is not there')]
    error = pose_error(run.estimate.pose, run.truth.pose, run.model.symmetry)
    level = run.model.symmetry.credible_level(run.truth.pose, run.estimate.pose,
                                              run.estimate.covariance,
                                              run.estimate.degrees_of_freedom)
    return [Fact('error', 'off the truth by', f'{1e3 * error.translation:.1f} mm, '
                 f'{np.rad2deg(error.rotation):.1f}°',
                 f'{1e3 * error.ray:+.1f} mm along the line of sight'),
            Fact('level', 'credible region with the truth', f'{100 * level:.0f} %')]


def _short(sigma: float) -> str:
    return f'{sigma:.2f}' if sigma < 1 else f'{sigma:.1f}'


def _modes(run: Localization) -> list[list[str]]:
    rows = []
    for each in run.estimate.modes:
        off = np.linalg.norm(each.pose[:3, 3] - run.estimate.pose[:3, 3])
        turned = run.model.symmetry.rotation_distance(each.pose[None], run.estimate.pose)[0]
        x, y, z = 1e3 * each.pose[:3, 3]
        rows.append([f'{x:.1f}, {y:.1f}, {z:.1f}', f'{100 * each.weight:.1f} %',
                     f'{each.score:.1f}', f'{1e3 * off:.1f}', f'{np.rad2deg(turned):.1f}'])
    return rows


def _search(run: Localization) -> list[list[str]]:
    stages = [(stage, list(group)) for stage, group in groupby(run.history,
                                                               lambda each: each.stage)]
    if not stages:
        return []
    # A stage comes again where the object was searched again: what the first one took is the rest.
    spent = [0.0, *np.diff([generations[-1].time for _, generations in stages])]
    spent[0] = run.seconds[stages[0][0]] - sum(
        seconds for (stage, _), seconds in zip(stages, spent, strict=True)
        if stage == stages[0][0])
    rows = []
    for (stage, generations), seconds in zip(stages, spent, strict=True):
        last = generations[-1]
        apart = search_drawings.spread(last.poses)
        rows.append([_STAGES[stage], f'{len(generations)}', f'{len(last.poses)}',
                     f'{1e3 * apart.across:.2f}', f'{1e3 * apart.along:.2f}',
                     f'{np.max(last.scores):.4g}', f'{1e3 * seconds:.0f}'])
    return rows


def _rows(settings: Settings) -> list[tuple[str, object, object]]:
    """Name, value and default of each setting."""
    return [(name, getattr(settings, name), default_of(field))
            for name, field in type(settings).model_fields.items()]
