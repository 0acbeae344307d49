"""`pmcl compare`: two studies of feasibility, cell by cell."""

from pathlib import Path

import click

from pmcl_ros.cli.base import FOLDER
from pmcl_ros.cli.simulations.options import aim_options
from pmcl_ros.evaluation.feasibility.comparison import HEAD, pairs, studied, verdict
from pmcl_ros.evaluation.feasibility.findings import Aim
from pmcl_ros.evaluation.results import table


@click.command()
@click.argument('first', type=FOLDER)
@click.argument('second', type=FOLDER)
@aim_options
def compare(first: Path, second: Path, millimetres: float, degrees: float) -> None:
    """Compare the shares of good poses of two studies, as of two cameras or renderers.

    FIRST and SECOND are folders of `pmcl feasibility`. Cells with few scenes are left out.
    """
    compared = pairs(studied(first), studied(second), Aim(millimetres, degrees))
    click.echo(table(HEAD, [each.row() for each in compared]))
    click.echo(f'\n{verdict(compared)}')
