"""`pmcl figures`: the drawings of the documentation."""

from pathlib import Path

import click

from pmcl_ros.cli.base import FOLDER
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.evaluation.studies.figures import FIGURES, TABLES


@click.command()
@click.argument('folder', type=FOLDER)
@click.option('--only', type=click.Choice(list(FIGURES)), help='Only this drawing.')
@click.option('--tables', is_flag=True, help='Print their numbers too, as Markdown.')
def figures(folder: Path, only: str | None, tables: bool) -> None:
    """Draw the documentation's figures into FOLDER, as PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in [only] if only else FIGURES:
        write_png(folder / f'{name}.png', FIGURES[name]())
        click.echo(folder / f'{name}.png')
        if tables and name in TABLES:
            click.echo(TABLES[name]())
