"""`pmcl coverage`, `pmcl learn`: what the posterior rests on, measured and learned again."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np
from rich.progress import track

from pmcl_ros.cli.base import FOLDER, STDERR
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.captures import Capture, find_captures
from pmcl_ros.evaluation.studies.coverage import run_coverage
from pmcl_ros.evaluation.studies.crease_study import (
    Result,
    crease_profile,
    table,
    with_and_without,
)
from pmcl_ros.evaluation.studies.searches import Search, Supports, searches
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import edge_volume
from pmcl_ros.learning.contour_errors import LEVEL, fitted_error
from pmcl_ros.learning.contour_tables import Example, Samples, fitted, profiles
from pmcl_ros.pmcl.creases import Creases
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer

_LARGEST = 0.14  # m: radius of any generated object
_FALSE_ALARMS = 0.05


@click.command()
@click.option('--trials', type=click.IntRange(1), default=200, show_default=True)
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True)
@click.option('--near', is_flag=True, help='Start beside the truth: quicker.')
def coverage(trials: int, seed: int, near: bool) -> None:
    """Tell how often the truth lies in the credible regions, on random volumes."""
    found = list(track(run_coverage(trials, seed, not near), total=trials, console=STDERR,
                       description='volumes', transient=True))
    levels = np.array([each.level for each in found])
    right = np.array([each.translation < 0.02 and each.rotation < np.deg2rad(10)
                      for each in found])
    kept = np.array([not each.lost for each in found])
    for wanted in (0.5, 0.9, 0.97):
        inside = levels <= wanted
        told = f'{100 * inside[kept].mean():.1f} %' if kept.any() else 'none'
        click.echo(f'in the {100 * wanted:.0f} % region: {100 * inside.mean():.1f} %; of those '
                   f'not lost: {told}')
    click.echo(f'within 2 cm and 10 degrees: {100 * right.mean():.1f} %; lost: '
               f'{100 * np.mean([each.lost for each in found]):.1f} %; median error '
               f'{1e3 * np.median([each.translation for each in found]):.2f} mm')


@click.command()
@click.argument('folder', type=FOLDER)
@click.option('--views', type=click.IntRange(3), default=7, show_default=True,
              help='Side of the square of views that are used.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True)
@click.option('--creases', is_flag=True, help='Learn what edges across creases of objects '
              'without an axis say, and what that adds, instead.')
def learn(folder: Path, views: int, seed: int, creases: bool) -> None:
    """Learn what the posterior rests on from captures with truth, as `pmcl scenes render` makes.

    Prints the contour's profile (for pmcl/contour_profile.py), how far contours lie off (for
    pmcl/model_error.py), and from what support and evidence on an object is found (for
    pmcl/support.py and pmcl/contour_profile.py).
    """
    captures = find_captures(folder)
    if creases:
        _learn_creases(captures, views, seed)
        return
    halves: list[list[Samples]] = [[], []]
    for number, each in enumerate(examples_of(captures, views, 'profiles')):
        rng = np.random.default_rng([seed, number])
        halves[number % 2] += profiles(each, NumbaRenderer(), rng)
    profile = fitted(Samples.joined(halves[0] + halves[1]))
    _print(profile)
    # Each half is searched with what the other half teaches.
    looked: list[Search] = []
    for half in range(2):
        chosen = examples_of(captures[half::2], views, f'searches {half + 1} of 2')
        looked += searches(chosen, fitted(Samples.joined(halves[1 - half])), seed)
    supports = Supports.of(looked)
    least = supports.threshold(_FALSE_ALARMS)
    click.echo(f'support of objects there: {np.sort(supports.there).round(2).tolist()}')
    click.echo('support of objects that are elsewhere: '
               f'{np.sort(supports.elsewhere).round(2).tolist()}')
    click.echo(f'least support {least:.2f}, at {100 * _FALSE_ALARMS:.0f} % false alarms; '
               f'{100 * supports.missed(least):.0f} % of what is there has less')
    evidence = supports.least_evidence(_FALSE_ALARMS)
    click.echo(f'evidence of objects found: {np.sort(supports.evidence).round(2).tolist()}')
    click.echo(f'least evidence {evidence:.2f}: {100 * _FALSE_ALARMS:.0f} % of them have less')
    deviations = [each.deviation for each in looked if each.deviation is not None
                  and each.support >= least and each.evidence >= evidence]
    error = fitted_error(deviations)
    levels = np.array([each.level(error.common, error.local) for each in deviations])
    click.echo(f'model error: {error.common:.2f} px in common, {error.local:.2f} px locally')
    for level in (0.5, LEVEL):
        click.echo(f'truths in the {100 * level:.0f} % region: '
                   f'{100 * (levels <= level).mean():.0f} % of {len(levels)}')


def _learn_creases(captures: Sequence[Capture], views: int, seed: int) -> None:
    """Print their profile, and what searches by the other half's find with it and without."""
    halves: list[list[Samples]] = [[], []]
    for number, each in enumerate(examples_of(captures, views, 'profiles')):
        rng = np.random.default_rng([seed, number])
        halves[number % 2] += profiles(each, NumbaRenderer(), rng, of_creases=True)
    _print(crease_profile(halves[0] + halves[1]))
    results: dict[str, list[tuple[Result, Result]]] = {}
    for half in range(2):
        profile = crease_profile(halves[1 - half])
        chosen = captures[half::2]
        for capture, each in zip(chosen, examples_of(chosen, views, f'searches {half + 1} of 2'),
                                 strict=True):
            if each.there and Creases.of(each.model) is not None:
                pair = with_and_without(each, profile, seed)
                results.setdefault(capture.truth.name.partition(':')[0], []).append(pair)
                click.echo(f'{capture.truth.name or capture.name}: ' + '; '.join(
                    f'{1e3 * one.translation:.1f} mm, {np.rad2deg(one.rotation):.1f} deg'
                    + (', lost' if one.lost else '') for one in pair))
    for kind, pairs in results.items():
        click.echo(f'{kind}:')
        for line in table(pairs):
            click.echo(f'    {line}')


def _print(profile: ContourProfile) -> None:
    click.echo('rows: offsets; columns: knots')
    for row in profile.tables:
        click.echo(f'    ({", ".join(f"{each + 0:.2f}" for each in row.round(2))}),')
    click.echo(f'bias {profile.bias:.2f}')


def examples_of(captures: Sequence[Capture], views: int, told: str) -> Iterator[Example]:
    """Of each capture, as it is read. views: side of the square that is used. told: what for."""
    for each in track(captures, console=STDERR, description=told, transient=True):
        truth = each.truth
        region = Region(truth.roi_center, truth.roi_size)
        labels = depth_labels(*region.grown(_LARGEST), DlvSettings().edge_labels)
        yield Example(edge_volume(each.light_field(None), labels, views),
                      ObjectModel.load(each.model), truth.pose, region, not truth.empty)
