"""`pmcl figures`: the drawings of the documentation."""

from pathlib import Path

import click

from pmcl_ros.cli.base import FOLDER
from pmcl_ros.evaluation.figures import FIGURES
from pmcl_ros.evaluation.pictures import write_png


@click.command()
@click.argument('folder', type=FOLDER)
@click.option('--only', type=click.Choice(list(FIGURES)), help='Only this drawing.')
def figures(folder: Path, only: str | None) -> None:
    """Draw the documentation's figures into FOLDER, as PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in [only] if only else FIGURES:
        write_png(folder / f'{name}.png', FIGURES[name]())
        click.echo(folder / f'{name}.png')
