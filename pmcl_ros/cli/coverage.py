"""`pmcl coverage`: how often the truth lies in the posterior's credible regions."""

import click
import numpy as np
from rich.progress import track

from pmcl_ros.cli.base import STDERR
from pmcl_ros.evaluation.recall import median, share, values
from pmcl_ros.evaluation.studies.coverage import run_coverage


@click.command()
@click.option('--trials', type=click.IntRange(1), default=200, show_default=True)
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True)
@click.option('--near', is_flag=True, help='Start beside the truth: quicker.')
def coverage(trials: int, seed: int, near: bool) -> None:
    """Print how often the truth lies in the credible regions, on random volumes."""
    found = list(track(run_coverage(trials, seed, not near), total=trials, console=STDERR,
                       description='volumes', transient=True))
    levels, lost = values(found, 'credible_level'), values(found, 'lost') > 0
    for wanted in (0.5, 0.9, 0.97):
        inside = levels <= wanted
        kept = f'{100 * share(inside[~lost]):.1f} %' if not lost.all() else 'none'
        click.echo(f'in the {100 * wanted:.0f} % region: {100 * share(inside):.1f} %; of those '
                   f'not lost: {kept}')
    click.echo(f'within 2 cm and 10 degrees: {100 * share([each.near for each in found]):.1f} %; '
               f'lost: {100 * np.mean(lost):.1f} %; median error '
               f'{median(found, "translation_mm"):.2f} mm')
