"""`pmcl coverage`, `pmcl learn`: what the posterior rests on, measured and learned again."""

from collections.abc import Iterator

import click
import numpy as np
from rich.progress import track

from pmcl_ros.cli.base import STDERR
from pmcl_ros.dlv.edges import edge_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.coverage import run_coverage
from pmcl_ros.evaluation.learning import Example, fitted, samples
from pmcl_ros.evaluation.scenes.random_scene import random_scene
from pmcl_ros.evaluation.scenes.render import render
from pmcl_ros.evaluation.scenes.settings import SceneSettings
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.back_end import make_renderer


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
    for wanted in (0.5, 0.9, 0.97):
        click.echo(f'in the {100 * wanted:.0f} % region: {100 * (levels <= wanted).mean():.1f} %')
    click.echo(f'within 2 cm and 10 degrees: {100 * right.mean():.1f} %; lost: '
               f'{100 * np.mean([each.lost for each in found]):.1f} %; median error '
               f'{1e3 * np.median([each.translation for each in found]):.2f} mm')


@click.command()
@click.option('--scenes', type=click.IntRange(1), default=200, show_default=True)
@click.option('--seed', type=click.IntRange(0), default=7, show_default=True)
def learn(scenes: int, seed: int) -> None:
    """Learn the contour's profile from generated scenes, and print its table."""
    click.echo('rows: offsets; columns: knots (pmcl/contour_profile.py)')
    found = fitted(samples(_examples(scenes, seed), make_renderer('numba'),
                           np.random.default_rng(seed)))
    for row in found.tables:
        click.echo(f'    ({", ".join(f"{each + 0:.2f}" for each in row.round(2))}),')
    click.echo(f'bias {found.bias:.2f}')


def _examples(scenes: int, seed: int) -> Iterator[Example]:
    for number in track(range(scenes), console=STDERR, description='scenes', transient=True):
        rng = np.random.default_rng([seed, number])
        capture = render(random_scene(rng, SceneSettings(empty=0.0)), rng)
        model, target = capture.model(), capture.targets[0]
        region = Region(target.roi_center, target.roi_size)
        labels = depth_labels(*region.grown(model.radius), DlvSettings().edge_labels)
        yield Example(edge_volume(capture.light_field, labels), model, target.pose, region)
