"""What the commands share: one-line errors, kinds of arguments, the options of a capture."""

import errno
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.errors import PmclError
from pmcl_ros.lightfield.calibration import Calibration
from pmcl_ros.lightfield.decode import VIEWS
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.sources.read import is_light_field, read_light_field

STDERR = Console(stderr=True)
FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
PATH = click.Path(exists=True, path_type=Path)
_CALIBRATION = "The camera's calibration, YAML."
_WHITE = ("The camera's white image, RAW[.xz] with its TXT, or a folder of such: the one that "
          'fits the picture is chosen.')


class Commands(click.Group):
    """Turns what the package or the disk refuses into one line and exit status 1."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; what the package refuses is told without a traceback."""
        try:
            return super().invoke(ctx)
        except PmclError as error:
            raise click.ClickException(str(error)) from error
        except OSError as error:  # a folder that cannot be made or written, a full disk
            if error.errno == errno.EPIPE:  # the reader of the output has gone: click ends
                raise
            where = f'{error.filename}: ' if error.filename else ''
            raise click.ClickException(f'{where}{error.strerror or error}') from error


def source_options(command: Callable[..., None]) -> Callable[..., None]:
    """The arguments of every command that takes a raw picture or a light field."""
    for option in (
            click.argument('source', type=PATH),
            click.option('--calibration', type=FILE, help=f'Of a raw picture: {_CALIBRATION}'),
            click.option('--white', type=PATH, help=f'Of a raw picture: {_WHITE}'),
            click.option('--every', type=click.IntRange(1), default=1, metavar='K',
                         help='Of a light field: each K-th view alone.'),
            click.option('--shrink', type=click.IntRange(1), default=1, metavar='N',
                         help='Of a light field: make NxN pixels one.')):
        command = option(command)
    return command


def open_source(source: Path, calibration: Path | None, white: Path | None, every: int,
                shrink: int) -> Callable[[], LightField]:
    """What makes a light field of a raw picture, or of any other source.

    All that belongs to the camera, not to the picture, has been read when this returns.
    """
    if is_light_field(source):
        return partial(read_light_field, source, every, shrink)
    if calibration is None or white is None:
        raise click.UsageError(f'{source} is a raw picture: it needs --calibration and --white')
    if (every, shrink) != (1, 1):
        raise click.UsageError(f'{source} is a raw picture: --every and --shrink are for light '
                               'fields')
    decoder, frame = open_decoders(Calibration.load(calibration), white), read_raw_frame(source)
    decoder.of(frame.metadata)
    return partial(decoder.decode, frame)


def open_decoders(calibration: Calibration, white: Path, views: int = VIEWS,
                  size: tuple[int, int] | None = None) -> Decoders:
    """Decoders that tell the user each choice among a folder's white images."""
    told = (lambda why: STDERR.print(f'white image: {why}', markup=False, soft_wrap=True)
            ) if white.is_dir() else None
    return Decoders(calibration, white, told, views, size)
