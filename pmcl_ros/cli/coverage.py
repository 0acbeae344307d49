"""`pmcl coverage`: how often the truth lies in the posterior's credible regions."""

import click
import numpy as np
from rich.progress import track

from pmcl_ros.cli.base import STDERR
from pmcl_ros.evaluation.errors import is_right
from pmcl_ros.evaluation.studies.coverage import run_coverage


@click.command()
@click.option('--trials', type=click.IntRange(1), default=200, show_default=True)
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True)
@click.option('--near', is_flag=True, help='Start beside the truth: quicker.')
def coverage(trials: int, seed: int, near: bool) -> None:
    """Tell how often the truth lies in the credible regions, on random volumes."""
    found = list(track(run_coverage(trials, seed, not near), total=trials, console=STDERR,
                       description='volumes', transient=True))
    levels = np.array([each.level for each in found])
    right = np.array([is_right(each.translation, each.rotation) for each in found])
    kept = np.array([not each.lost for each in found])
    for wanted in (0.5, 0.9, 0.97):
        inside = levels <= wanted
        told = f'{100 * inside[kept].mean():.1f} %' if kept.any() else 'none'
        click.echo(f'in the {100 * wanted:.0f} % region: {100 * inside.mean():.1f} %; of those '
                   f'not lost: {told}')
    click.echo(f'within 2 cm and 10 degrees: {100 * right.mean():.1f} %; lost: '
               f'{100 * np.mean([each.lost for each in found]):.1f} %; median error '
               f'{1e3 * np.median([each.translation for each in found]):.2f} mm')
