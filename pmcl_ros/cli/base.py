"""Shared by the commands: one-line errors, kinds of arguments."""

import errno
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from pmcl_ros.runtime.errors import PmclError, SettingsError
from pmcl_ros.runtime.resources import calibration_file

STDERR = Console(stderr=True)
FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
PATH = click.Path(exists=True, path_type=Path)
OF_CAMERA = ('The white image is a picture of an evenly lit white surface, or the folder of those '
             'of the camera (T1CALIB); pmcl calibrate makes the calibration: docs/howto/camera.md')
FORCE = click.option('--force', is_flag=True, help='Overwrite files that are there already.')


def calibration_type(text: str) -> Path:
    """A calibration's file, of its path or the name of its camera; click's kind of an option."""
    try:
        return calibration_file(text)
    except SettingsError as error:
        raise click.BadParameter(str(error)) from None


class Commands(click.Group):
    """Prints errors of the package and the disk as one line; the exit status is 1.

    sections: of the help, each with the module of a command, below pmcl_ros.cli, and one line of
    help. The module is imported when the command is called: most need large libraries.
    """

    def __init__(self, *args: Any, sections: Mapping[str, Mapping[str, tuple[str, str]]],
                 **options: Any) -> None:
        super().__init__(*args, **options)
        self._sections = sections
        self._modules = {name: module for each in sections.values()
                         for name, (module, _) in each.items()}

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """All names."""
        return sorted(self._modules)

    def get_command(self, ctx: click.Context, name: str  # noqa: ARG002
                    ) -> click.Command | None:
        """The command of a name, if there is one."""
        if name not in self._modules:
            return None
        module = import_module(f'pmcl_ros.cli.{self._modules[name]}')
        command = getattr(module, name.replace('-', '_'))
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context,  # noqa: ARG002
                        formatter: click.HelpFormatter) -> None:
        """The commands by section, without importing any."""
        for section, commands in self._sections.items():
            with formatter.section(section):
                formatter.write_dl([(name, text) for name, (_, text) in commands.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; print errors of the package without a traceback."""
        try:
            return super().invoke(ctx)
        except PmclError as error:
            raise click.ClickException(str(error)) from error
        except OSError as error:  # a folder that cannot be made or written, a full disk
            if error.errno == errno.EPIPE:  # the reader of the output has gone: click ends
                raise
            where = f'{error.filename}: ' if error.filename else ''
            raise click.ClickException(f'{where}{error.strerror or error}') from error
