"""Opens a source: a raw picture with its camera, views, or an ordinary picture."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import click

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.cli.base import FILE, PATH, STDERR
from pmcl_ros.lightfield.calibration.calibration import Calibration
from pmcl_ros.lightfield.decode import VIEWS
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.readers.colmap import Metric
from pmcl_ros.lightfield.readers.read import Source, is_light_field, read_source


def source_options(command: Callable[..., None]) -> Callable[..., None]:
    """The arguments of every command that takes a raw picture or a light field."""
    for option in (
            click.argument('source', type=PATH),
            click.option('--calibration', type=FILE,
                         help="Of a raw picture: the camera's calibration, YAML."),
            click.option('--white', type=PATH, help="Of a raw picture: the camera's white image, "
                         'RAW[.xz] with its TXT, or a folder of white images: the one that fits '
                         'the picture is chosen.'),
            click.option('--every', type=click.IntRange(1), default=1, metavar='K',
                         help='Of a light field: each K-th view alone.'),
            click.option('--shrink', type=click.IntRange(1), default=1, metavar='N',
                         help='Of a light field or an ordinary picture: make NxN pixels one.'),
            click.option('--scale', type=click.FloatRange(0, min_open=True), metavar='METRES',
                         help='Of a COLMAP model, which has no metric scale: metres a unit.'),
            click.option('--distance', type=(str, str, click.FloatRange(0, min_open=True)),
                         metavar='NAME NAME METRES', help='Of a COLMAP model, in place of '
                         '--scale: the distance between the cameras of two pictures.')):
        command = option(command)
    return command


def open_source(source: Path, calibration: Path | None, white: Path | None, every: int,
                shrink: int, scale: float | None = None,
                distance: tuple[str, str, float] | None = None) -> Callable[[], Source]:
    """A function that makes the light field of a raw picture, or reads views or pictures.

    Calibration and white image have been read when this returns.
    """
    if scale is not None and distance is not None:
        raise click.UsageError('--scale and --distance say the same: give one')
    if is_light_field(source):
        return partial(read_source, source, every, shrink, Metric(scale, distance))
    if calibration is None or white is None:
        raise click.UsageError(f'{source} is a raw picture: it needs --calibration and --white')
    if (every, shrink) != (1, 1):
        raise click.UsageError(f'{source} is a raw picture: --every and --shrink are for light '
                               'fields')
    decoders, frame = open_decoders(Calibration.load(calibration), white), read_raw_frame(source)
    decoders.decoder_for(frame.metadata)
    return partial(decoders.decode, frame)


def open_decoders(calibration: Calibration, white: Path, views: int = VIEWS,
                  size: tuple[int, int] | None = None) -> Decoders:
    """Decoders that print each choice among a folder's white images."""
    report = (lambda why: STDERR.print(f'white image: {why}', markup=False, soft_wrap=True)
            ) if white.is_dir() else None
    return Decoders(calibration, white, report, views, size)
