"""`pmcl learn`: learn the numbers of the contour evidence from generated scenes."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from pmcl_ros.cli.base import FOLDER, FORCE, STDERR
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.captures import Capture, find_captures
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import edge_volume
from pmcl_ros.evidence.learned import LearnedContour, LearnedMapEvidence, LearnedProfile
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.student_t import COMMON, credible_level
from pmcl_ros.learning.contour_errors import (
    Deviation,
    fitted_degrees_of_freedom,
    fitted_error,
    fitted_offset,
)
from pmcl_ros.learning.contour_tables import Example, Samples, crease_profile, fitted, profiles
from pmcl_ros.learning.posed_views import ViewsExample, learned_from
from pmcl_ros.learning.posed_views import searches as posed_searches
from pmcl_ros.learning.searches import Search, Supports, searches, slopes_of
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.read import has_posed_views
from pmcl_ros.pipeline import apparent_size, build_evidence
from pmcl_ros.pmcl.estimator import Thresholds
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.outputs import refuse_existing
from pmcl_ros.warm_up.chain import DRAW, EDGES, ENERGIES, SEARCH
from pmcl_ros.warm_up.stage import compile_ahead

_LARGEST = 0.14  # m: radius of any generated object
_TOO_LITTLE = 0.05  # share of right poses by edges that have too little evidence
_TOO_LITTLE_OF_MAPS = 0.01  # the same by contour maps, whose rule for support asks for it too
# Of the log odds of a contour map. The network spreads a contour over three pixels, so that as
# many neighbours share their noise. Pixels of the inside are not counted: they ranked no true
# pose higher (docs/results/contour_map.md).
_WEIGHTS = {'contour_weight': 0.33, 'inside_weight': 0.0}
_LEAST_WEIGHT = 0.95  # of the posterior: one claimed pose in twenty may be another one
_DIGITS = 2  # of the numbers that are printed and written


@click.command()
@click.argument('folder', type=FOLDER)
@click.option('--views', type=click.IntRange(3), default=7, show_default=True,
              help='Side of the square of views that are used.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True)
@click.option('--creases', is_flag=True, help='Learn the profile across creases of objects '
              'without an axis instead.')
@click.option('--map', 'of_map', is_flag=True, help='Learn how the log odds of the contour map '
              'become evidence instead.')
@click.option('--posed', is_flag=True, help='Learn what the contour maps of several views say '
              'together instead, from captures of several views each.')
@click.option('--false-alarms', type=click.FloatRange(0, 1, min_open=True, max_open=True),
              default=0.05, show_default=True,
              help='Share of the searches for an object that is not there that may claim it. '
              '--creases learns no threshold.')
@click.option('-o', '--out', type=click.Path(dir_okay=False, path_type=Path),
              help='Write what is learned to this file, as config/learned/contour.yaml (with '
              '--creases: creases.yaml; --map: contour_map_evidence.yaml; --posed: views.yaml), '
              'which is read at start.')
@FORCE
def learn(folder: Path, views: int, seed: int, creases: bool, of_map: bool, posed: bool,
          false_alarms: float, out: Path | None, force: bool) -> None:
    """Learn the contour evidence from captures with truth, as `pmcl scenes render` makes.

    Prints the profile across contours, the support and evidence below which an object is lost, and
    the model's error. The support and the errors come from searches in each half of the scenes
    with the profile of the other half.
    """
    if creases + of_map + posed > 1:
        raise click.UsageError('--creases, --map and --posed are learned one after the other')
    if out is not None:
        refuse_existing([out], force)
        out.parent.mkdir(parents=True, exist_ok=True)  # first: the rest takes hours
    captures = find_captures(folder)
    for capture in captures:
        if not posed and has_posed_views(capture.source):
            raise _has_several(capture)
    compile_ahead(STDERR, SEARCH if posed else (
        *EDGES, *((*DRAW, *ENERGIES) if creases else SEARCH)))
    command = (f'pmcl learn {folder}{"" if posed else f" --views {views}"} --seed {seed}'
               f'{" --creases" * creases}{" --map" * of_map}{" --posed" * posed}'
               f'{"" if creases else f" --false-alarms {false_alarms:g}"} --out {out}')
    if posed:
        numbers_of_views = learned_from(
            list(posed_searches(_views_of(captures), seed)), _LEAST_WEIGHT, false_alarms,
            _TOO_LITTLE_OF_MAPS, click.echo)
        if out is not None:
            numbers_of_views.save(out, command)
        return
    if of_map:
        learned = _learn_map_evidence(captures, views, seed, false_alarms)
        if out is not None:
            learned.save(out, command)
        return
    halves: list[list[Samples]] = [[], []]
    for number, each in enumerate(examples_of(captures, views, 'profiles')):
        rng = np.random.default_rng([seed, number])
        halves[number % 2] += profiles(each, NumbaRenderer(), rng, of_creases=creases)
    both = halves[0] + halves[1]
    profile = crease_profile(both) if creases else fitted(Samples.joined(both))
    click.echo('rows: offsets; columns: knots')
    for row in _rounded(profile.tables):
        click.echo(f'    ({", ".join(f"{each:.2f}" for each in row)}),')
    click.echo(f'bias {profile.bias:.2f}')
    numbers: LearnedProfile = LearnedProfile.make(_fields(profile), 'the profile')
    if not creases:
        looked: list[Search] = []
        for half in range(2):
            chosen = examples_of(captures[half::2], views, f'searches {half + 1} of 2')
            looked += searches(chosen, fitted(Samples.joined(halves[1 - half])), seed)
        least = _thresholds(Supports.from_searches(looked), false_alarms, _TOO_LITTLE)
        numbers = LearnedContour.make(
            _fields(profile) | _learned(looked, least, false_alarms, _TOO_LITTLE), 'the profile')
    if out is not None:
        numbers.save(out, command)


def _learn_map_evidence(captures: Sequence[Capture], views: int, seed: int, false_alarms: float
                        ) -> LearnedMapEvidence:
    """Where contours are found, by searches with the weights; thresholds and errors by others."""
    numbers = LearnedMapEvidence(**_WEIGHTS, least_evidence=0, least_support=0, least_weight=0,
                                 common_error=1, local_error=1, error_length=1)
    first = list(searches(maps_of(captures, views, numbers, 'searches 1 of 2'), None, seed))
    offset = round(fitted_offset(_deviations(first, _of_map(first, false_alarms))), _DIGITS)
    click.echo(f'contours are found {offset:+.2f} px outwards')
    numbers = numbers.model_copy(update={'contour_offset': offset})
    looked = list(searches(maps_of(captures, views, numbers, 'searches 2 of 2'), None, seed))
    least = _of_map(looked, false_alarms)
    of_evidence, of_odds = least.slopes
    click.echo(f'of the support that is needed, {of_evidence:.2f} for each nat / px of evidence '
               f'and {of_odds:.2f} for each nat of the log odds of the weight are enough')
    return LearnedMapEvidence.make(
        _WEIGHTS | {'contour_offset': offset, 'least_weight': _LEAST_WEIGHT,
                    'evidence_slope': of_evidence, 'odds_slope': of_odds}
        | _learned(looked, least, false_alarms, _TOO_LITTLE_OF_MAPS, of_tails=True),
        'the contour map')


def _of_map(looked: Sequence[Search], false_alarms: float) -> Thresholds:
    """Of contour maps, where evidence and weight take the place of support."""
    of_evidence, of_odds = slopes_of(looked, _LEAST_WEIGHT)
    slopes = round(of_evidence, _DIGITS), round(of_odds, _DIGITS)
    return _thresholds(Supports.from_searches(looked, _LEAST_WEIGHT, slopes), false_alarms,
                       _TOO_LITTLE_OF_MAPS, _LEAST_WEIGHT, slopes)


def _thresholds(supports: Supports, false_alarms: float, too_little: float,
                weight: float = 0.0, slopes: tuple[float, float] = (0.0, 0.0)) -> Thresholds:
    return Thresholds(round(supports.threshold(false_alarms), _DIGITS),
                      round(supports.least_evidence(too_little), _DIGITS), weight, slopes)


def _deviations(looked: Sequence[Search], least: Thresholds) -> list[Deviation]:
    """Of right poses that are claimed."""
    return [each.deviation for each in looked
            if each.deviation is not None and each.is_claimed(least)]


def _learned(looked: Sequence[Search], least: Thresholds, false_alarms: float, too_little: float,
             of_tails: bool = False) -> dict[str, float]:
    """Print and return the least support, the least evidence and the model's error.

    false_alarms, too_little: that the thresholds were made for. of_tails: and the degrees of
    freedom of the errors of poses.
    """
    supports = Supports.from_searches(looked, least.weight, least.slopes)
    click.echo(f'support of objects there: {np.sort(supports.there).round(2).tolist()}')
    click.echo('support of objects that are elsewhere: '
               f'{np.sort(supports.elsewhere).round(2).tolist()}')
    click.echo(f'least support {least.support:.2f}, at {100 * false_alarms:g} % false alarms; '
               f'{100 * supports.missed(least.support):.0f} % of what is there has less')
    click.echo(f'evidence of objects found: {np.sort(supports.evidence).round(2).tolist()}')
    click.echo(f'least evidence {least.evidence:.2f}: {100 * too_little:.0f} % of them have less')
    deviations = _deviations(looked, least)
    error = fitted_error(deviations)
    common, local = (max(round(each, _DIGITS), 10 ** -_DIGITS)  # as written
                     for each in (error.common, error.local))
    click.echo(f'model error: {common:.2f} px in common, {local:.2f} px locally')
    squares = [each.square(common, local) for each in deviations]
    dimensions = [len(each.deviation) for each in deviations]
    degrees = fitted_degrees_of_freedom(squares, dimensions) if of_tails else math.inf
    if of_tails:
        click.echo(f"degrees of freedom of Student's t: {degrees:g}")
    levels = credible_level(squares, dimensions, degrees)
    for level in (0.5, COMMON):
        click.echo(f'truths in the {100 * level:.0f} % region: '
                   f'{100 * (levels <= level).mean():.0f} % of {len(levels)}')
    return {'least_evidence': least.evidence, 'least_support': least.support,
            'common_error': common, 'local_error': local, 'error_length': error.length,
            **({'degrees_of_freedom': degrees} if of_tails else {})}


def _fields(profile: ContourProfile) -> dict[str, object]:
    return {'offsets': profile.offsets.tolist(),
            'knots': profile.knots.astype(float).round(6).tolist(),  # of float32
            'tables': _rounded(profile.tables),
            'bias': round(profile.bias, _DIGITS)}


def _rounded(tables: NDArray[np.float32]) -> list[list[float]]:
    """Without negative zeros."""
    return [[float(f'{each + 0:.{_DIGITS}f}') for each in row] for row in tables.round(_DIGITS)]


def _has_several(capture: Capture) -> SettingsError:
    return SettingsError(f'{capture.folder} has several views; learn from them with --posed')


def examples_of(captures: Sequence[Capture], views: int, purpose: str) -> Iterator[Example]:
    """An example of each capture. views: side of the square of views used. purpose: of the bar."""
    for each in track(captures, console=STDERR, description=purpose, transient=True):
        truth = each.truth
        region = Region(truth.roi_center, truth.roi_size)
        labels = depth_labels(*region.grown(_LARGEST), DlvSettings().edge_labels)
        yield Example(edge_volume(each.light_field(), labels, views),
                      ObjectModel.load(each.model), truth.pose, region, not truth.empty)


def _views_of(captures: Sequence[Capture]) -> Iterator[ViewsExample]:
    """An example of each capture of several views. Raises SettingsError for another capture."""
    for each in track(captures, console=STDERR, description='searches', transient=True):
        truth, source = each.truth, each.read(None)
        if not isinstance(source, PosedViews):
            raise SettingsError(f'{each.folder} has no several views; render them with pmcl '
                                'scenes render --cameras')
        model = ObjectModel.load(each.model)
        settings = PmclSettings(roi_center=truth.roi_center, roi_size=truth.roi_size)
        evidence = build_evidence(source, DlvSettings(), 'default', 'map',
                                  apparent_size(model, settings))
        assert isinstance(evidence, ViewsEvidence)
        yield ViewsExample(evidence, model, truth.pose, settings, not truth.empty)


def maps_of(captures: Sequence[Capture], views: int, numbers: LearnedMapEvidence, purpose: str
            ) -> Iterator[Example]:
    """An example of each capture, by its contour map."""
    for each in track(captures, console=STDERR, description=purpose, transient=True):
        truth, source = each.truth, each.read(None)
        if isinstance(source, PosedViews):
            raise _has_several(each)
        region = Region(truth.roi_center, truth.roi_size)
        near, far = region.grown(_LARGEST)
        settings = DlvSettings.make({'near': near, 'far': far, 'views': views}, str(each.folder))
        odds = build_map(source, settings, numbers=numbers)
        yield Example(odds, ObjectModel.load(each.model), truth.pose, region, not truth.empty)
