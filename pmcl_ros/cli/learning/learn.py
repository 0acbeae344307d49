"""`pmcl learn`: learn the numbers of the contour evidence from generated scenes."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

import click
import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from pmcl_ros.cli.base import FOLDER, FORCE, STDERR, check_scheduler, process_options
from pmcl_ros.cli.learning.examples import (
    example_of_edges,
    example_of_map,
    example_of_views,
    has_several,
)
from pmcl_ros.evaluation.captures import Capture, find_captures
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.learned import (
    NO_SLOPES,
    LearnedContour,
    LearnedMapEvidence,
    LearnedProfile,
    SupportSlopes,
)
from pmcl_ros.geometry.student_t import COMMON, credible_level
from pmcl_ros.learning.contour_errors import (
    Deviation,
    fitted_degrees_of_freedom,
    fitted_error,
    fitted_offset,
)
from pmcl_ros.learning.contour_tables import Samples, crease_profile, fitted, profiles
from pmcl_ros.learning.posed_views import ViewsSearch, learned_from
from pmcl_ros.learning.posed_views import searches as posed_searches
from pmcl_ros.learning.searches import Search, Supports, searches, slopes_of
from pmcl_ros.lightfield.readers.read import has_posed_views
from pmcl_ros.pmcl.estimator import Thresholds
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.runtime.outputs import refuse_existing
from pmcl_ros.simulation.processes import run_all
from pmcl_ros.warm_up.chain import DRAW, EDGES, ENERGIES, SEARCH
from pmcl_ros.warm_up.stage import compile_ahead

_TOO_LITTLE = 0.05  # share of right poses by edges that have too little evidence
_TOO_LITTLE_OF_MAPS = 0.01  # the same by contour maps, whose rule for support asks for it too
# Of the log odds of a contour map. The network spreads a contour over three pixels, so that as
# many neighbours share their noise. Pixels of the inside are not counted: they ranked no true
# pose higher (docs/results/contour_map.md).
_WEIGHTS = {'contour_weight': 0.33, 'inside_weight': 0.0}
_LEAST_WEIGHT = 0.95  # of the posterior: one claimed pose in twenty may be another one
_DIGITS = 2  # of the numbers that are printed and written
Found = TypeVar('Found')  # a search


class Processes(NamedTuple):
    """In which the searches run: the last arguments of `run_all`."""

    jobs: int
    backend: str
    scheduler: str | None


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
@process_options
@FORCE
def learn(folder: Path, views: int, seed: int, creases: bool, of_map: bool, posed: bool,
          false_alarms: float, jobs: int, backend: str, scheduler: str | None, out: Path | None,
          force: bool) -> None:
    """Learn the contour evidence from captures with truth, as `pmcl scenes render` makes.

    Prints the profile across contours, the support and evidence below which an object is lost, and
    the model's error. The support and the errors come from searches in each half of the scenes
    with the profile of the other half.
    """
    if creases + of_map + posed > 1:
        raise click.UsageError('--creases, --map and --posed are learned one after the other')
    check_scheduler(backend, scheduler)
    processes = Processes(jobs, backend, scheduler)
    if out is not None:
        refuse_existing([out], force)
        out.parent.mkdir(parents=True, exist_ok=True)  # first: the rest takes hours
    captures = find_captures(folder)
    for capture in captures:
        if not posed and has_posed_views(capture.source):
            raise has_several(capture)
    compile_ahead(STDERR, SEARCH if posed else (
        *EDGES, *((*DRAW, *ENERGIES) if creases else SEARCH)))
    command = (f'pmcl learn {folder}{"" if posed else f" --views {views}"} --seed {seed}'
               f'{" --creases" * creases}{" --map" * of_map}{" --posed" * posed}'
               f'{"" if creases else f" --false-alarms {false_alarms:g}"} --out {out}')
    if posed:
        numbers_of_views = learned_from(
            _all_searches(partial(_search_views, seed=seed), captures, processes, 'searches'),
            _LEAST_WEIGHT, false_alarms, _TOO_LITTLE_OF_MAPS, click.echo)
        if out is not None:
            numbers_of_views.save(out, command)
        return
    if of_map:
        learned = _learn_map_evidence(captures, views, seed, false_alarms, processes)
        if out is not None:
            learned.save(out, command)
        return
    halves: list[list[Samples]] = [[], []]
    for number, each in enumerate(track(captures, console=STDERR, description='profiles',
                                        transient=True)):
        rng = np.random.default_rng([seed, number])
        halves[number % 2] += profiles(example_of_edges(each, views), NumbaRenderer(), rng,
                                       of_creases=creases)
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
            of_others = fitted(Samples.joined(halves[1 - half]))
            looked += _all_searches(
                partial(_search_edges, views=views, profile=of_others, seed=seed),
                captures[half::2], processes, f'searches {half + 1} of 2')
        least = _thresholds(Supports.from_searches(looked), false_alarms, _TOO_LITTLE)
        numbers = LearnedContour.make(
            _fields(profile) | _learned(looked, least, false_alarms, _TOO_LITTLE), 'the profile')
    if out is not None:
        numbers.save(out, command)


def _search_edges(capture: Capture, others: Sequence[ObjectModel], views: int,
                  profile: ContourProfile, seed: int) -> list[Search]:
    return list(searches(example_of_edges(capture, views), others, profile, seed))


def _search_map(capture: Capture, others: Sequence[ObjectModel], views: int,
                numbers: LearnedMapEvidence, seed: int) -> list[Search]:
    return list(searches(example_of_map(capture, views, numbers), others, None, seed))


def _search_views(capture: Capture, others: Sequence[ObjectModel], seed: int
                  ) -> list[ViewsSearch]:
    return list(posed_searches(example_of_views(capture), others, seed))


def _all_searches(search: Callable[[Capture, Sequence[ObjectModel]], list[Found]],
                  captures: Sequence[Capture], processes: Processes, purpose: str) -> list[Found]:
    """Of each capture in turn, for its own object and for that of the one before.

    purpose: of the bar.
    """
    scenes = [(number, each, captures[number - 1].model if number else None)
              for number, each in enumerate(captures)]
    done = track(run_all(partial(_numbered, search), scenes, *processes), total=len(scenes),
                 console=STDERR, description=purpose, transient=True)
    return [each for _, found in sorted(done, key=lambda one: one[0]) for each in found]


def _numbered(search: Callable[[Capture, Sequence[ObjectModel]], list[Found]],
              scene: tuple[int, Capture, Path | None]) -> tuple[int, list[Found]]:
    number, capture, other = scene
    return number, search(capture, [] if other is None else [ObjectModel.load(other)])


def _learn_map_evidence(captures: Sequence[Capture], views: int, seed: int, false_alarms: float,
                        processes: Processes) -> LearnedMapEvidence:
    """Where contours are found, by searches with the weights; thresholds and errors by others."""
    numbers = LearnedMapEvidence(**_WEIGHTS, least_evidence=0, least_support=0, least_weight=0,
                                 common_error=1, local_error=1, error_length=1)
    first = _all_searches(partial(_search_map, views=views, numbers=numbers, seed=seed), captures,
                          processes, 'searches 1 of 2')
    offset = round(fitted_offset(_deviations(first, _of_map(first, false_alarms))), _DIGITS)
    click.echo(f'contours are found {offset:+.2f} px outwards')
    numbers = numbers.model_copy(update={'contour_offset': offset})
    looked = _all_searches(partial(_search_map, views=views, numbers=numbers, seed=seed), captures,
                           processes, 'searches 2 of 2')
    least = _of_map(looked, false_alarms)
    slopes = least.slopes
    click.echo('of the support that is needed '
               f'{slopes.evidence:.2f} less for each nat / px of evidence, '
               f'{slopes.odds:.2f} less for each nat of the log odds of the weight, '
               f'{slopes.inside:.2f} more for each nat / px of the inside')
    return LearnedMapEvidence.make(
        _WEIGHTS | {'contour_offset': offset, 'least_weight': _LEAST_WEIGHT,
                    'evidence_slope': slopes.evidence, 'odds_slope': slopes.odds,
                    'inside_slope': slopes.inside}
        | _learned(looked, least, false_alarms, _TOO_LITTLE_OF_MAPS, of_tails=True),
        'the contour map')


def _of_map(looked: Sequence[Search], false_alarms: float) -> Thresholds:
    """Of contour maps, where evidence and weight take the place of support."""
    slopes = SupportSlopes(*(round(each, _DIGITS) for each in slopes_of(looked, _LEAST_WEIGHT)))
    return _thresholds(Supports.from_searches(looked, _LEAST_WEIGHT, slopes), false_alarms,
                       _TOO_LITTLE_OF_MAPS, _LEAST_WEIGHT, slopes)


def _thresholds(supports: Supports, false_alarms: float, too_little: float,
                weight: float = 0.0, slopes: SupportSlopes = NO_SLOPES) -> Thresholds:
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
