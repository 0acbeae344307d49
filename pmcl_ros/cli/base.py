"""What the commands share: one-line errors, kinds of arguments, the options of a capture."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from pmcl_ros.errors import PmclError

STDERR = Console(stderr=True)
FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)


class Commands(click.Group):
    """Turns the package's errors into one line and exit status 1."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; what the package refuses is told without a traceback."""
        try:
            return super().invoke(ctx)
        except PmclError as error:
            raise click.ClickException(str(error)) from error


def capture_options(command: Callable[..., None]) -> Callable[..., None]:
    """The arguments of every command that decodes one picture."""
    for option in (
            click.argument('raw', type=FILE),
            click.option('--calibration', required=True, type=FILE,
                         help="The camera's calibration, YAML."),
            click.option('--white', required=True, type=FILE,
                         help="The camera's white image, RAW[.xz] with its TXT.")):
        command = option(command)
    return command
