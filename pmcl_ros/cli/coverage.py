"""`pmcl coverage`, `pmcl learn`: what the posterior rests on, measured and learned again."""

from collections.abc import Iterable, Iterator

import click
import numpy as np
from rich.progress import track

from pmcl_ros.cli.base import STDERR
from pmcl_ros.dlv.edges import edge_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.coverage import run_coverage
from pmcl_ros.evaluation.learning import Example, fitted, samples, supports
from pmcl_ros.evaluation.scenes.random_scene import random_scene
from pmcl_ros.evaluation.scenes.render import render
from pmcl_ros.evaluation.scenes.settings import SceneSettings
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.back_end import make_renderer

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
@click.option('--scenes', type=click.IntRange(1), default=40, show_default=True,
              help='To learn the profile from.')
@click.option('--further', type=click.IntRange(2), default=20, show_default=True,
              help='To learn from when an object is lost.')
@click.option('--views', type=click.IntRange(3), default=5, show_default=True,
              help='Side of the square of views of a scene.')
@click.option('--seed', type=click.IntRange(0), default=7, show_default=True)
def learn(scenes: int, further: int, views: int, seed: int) -> None:
    """Learn the contour's profile, and what support it takes, from generated scenes; print both.

    The profile is for pmcl/contour_profile.py, the least support for pmcl/support.py.
    """
    profile = fitted(samples(_examples(range(scenes), views, seed), make_renderer('numba'),
                             np.random.default_rng(seed)))
    click.echo('rows: offsets; columns: knots')
    for row in profile.tables:
        click.echo(f'    ({", ".join(f"{each + 0:.2f}" for each in row.round(2))}),')
    click.echo(f'bias {profile.bias:.2f}')
    # Of scenes that the profile has not seen.
    found = supports(_examples(range(scenes, scenes + further), views, seed), profile, seed)
    least = found.threshold(_FALSE_ALARMS)
    click.echo(f'support of objects there: {found.there.round(2).tolist()}')
    click.echo(f'support of objects that are elsewhere: {found.elsewhere.round(2).tolist()}')
    click.echo(f'least support {least:.2f}, at {100 * _FALSE_ALARMS:.0f} % false alarms; '
               f'{100 * found.missed(least):.0f} % of what is there has less')


def _examples(numbers: Iterable[int], views: int, seed: int) -> Iterator[Example]:
    for number in track(numbers, console=STDERR, description='scenes', transient=True):
        rng = np.random.default_rng([seed, number])
        # A ray for each pixel and view: there are many views, and blurred ones.
        capture = render(random_scene(rng, SceneSettings(empty=0.0, views=views)), rng, samples=1)
        target = capture.targets[0]
        region = Region(target.roi_center, target.roi_size)
        labels = depth_labels(*region.grown(_LARGEST), DlvSettings().edge_labels)
        yield Example(edge_volume(capture.light_field, labels, views), capture.model(),
                      target.pose, region)
