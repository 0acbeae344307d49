"""`pmcl decode`: decode a raw picture into views, as NPZ and PNG files."""

import math
import re
from dataclasses import replace
from pathlib import Path

import click

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.mosaic_image import is_mosaic_image, read_mosaic_image
from pmcl_ros.camera.white_images import choose_white
from pmcl_ros.cli.base import (
    FILE,
    FOLDER,
    FORCE,
    OF_CAMERA,
    RAW,
    STDERR,
    WHITE,
    calibration_type,
    results_in,
)
from pmcl_ros.cli.sources import open_decoders
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.evaluation.studies.view_comparison import IdealViews, compare_views, table
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.colour import shades_of_grey
from pmcl_ros.lightfield.decode import VIEWS, Decoder
from pmcl_ros.lightfield.decoders import uncalibrated_decoder
from pmcl_ros.lightfield.readers.npz import save_npz, write_npz
from pmcl_ros.warm_up.raw import DECODE, light_stages
from pmcl_ros.warm_up.stage import compile_ahead


def _size(_context: click.Context, _option: click.Parameter,
          value: str | None) -> tuple[int, int] | None:
    """Width and height of WxH."""
    if value is None:
        return None
    found = re.fullmatch(r'([1-9]\d{0,3})x([1-9]\d{0,3})', value)
    if found is None:
        raise click.BadParameter(f'{value!r} is no size; expected width x height, as 328x328')
    return int(found[1]), int(found[2])


@click.command()
@click.argument('raw', type=RAW)
@click.option('--calibration', type=calibration_type, metavar='FILE|NAME',
              help="The camera's calibration, YAML, or the name of the camera; without it the "
              'views are lattice-aligned, with unknown geometry.')
@click.option('--white', type=WHITE, help="The camera's white image, RAW[.xz] with its TXT, or a "
              'folder of white images: the one that fits the picture is chosen. Without it and '
              '--calibration, the light is estimated from the picture.')
@click.option('--gain', type=float, default=1.0, show_default=True,
              help='Of a PNG or JPEG: factor applied to its intensity.')
@click.option('--views', type=click.IntRange(1), default=VIEWS, show_default=True,
              help='Views of a row and column, odd, one raw pixel apart.')
@click.option('--size', metavar='WxH', callback=_size,
              help="Of a view [px]; default: the calibration's.")
@click.option('-o', '--out', required=True, type=FOLDER, help='Folder for views.npz and pictures.')
@click.option('--compare', type=FILE, metavar='VIEWS.npz',
              help='Ideal lattice-aligned views, `views` (3, 3, height, width, 3) three steps '
              'apart: print how the decode differs from them.')
@FORCE
def decode(raw: Path, calibration: Path | None, white: Path | None, gain: float, views: int,
           size: tuple[int, int] | None, out: Path, compare: Path | None,
           force: bool) -> None:
    """Decode RAW into views: NPZ and PNG.

    RAW: .RAW or .RAW.xz with its .TXT, .LFP, or the sensor's mosaic as an 8-bit PNG or JPEG. With
    --calibration and --white the views are rectified.
    """
    results = results_in(out, force)
    npz, centre, sheet = map(results.path, ('views.npz', 'centre.png', 'views.png'))
    if gain != 1 and not is_mosaic_image(raw):
        raise click.UsageError(f'{raw} is no PNG or JPEG: --gain is for these')
    if calibration is not None and white is None:
        raise click.UsageError(f'--calibration needs --white. {OF_CAMERA}')
    # Read first, what needs no kernels to be read: so it is refused before they are compiled.
    image = read_mosaic_image(raw, gain) if is_mosaic_image(raw) else None
    compile_ahead(STDERR, DECODE if white is not None else (*DECODE, *light_stages()))
    frame = read_raw_frame(raw) if image is None else image
    if calibration is None or white is None:
        chosen = None if white is None else choose_white(white, frame.metadata).frame
        decoder = uncalibrated_decoder(frame, chosen, views, size)
    else:
        decoder = open_decoders(Calibration.load(calibration), white, views, size).decoder_for(
            frame.metadata)
    ideal = None if compare is None else IdealViews.load(compare)
    light_field = decoder.decode(frame)
    if is_mosaic_image(raw):  # its white balance is unknown
        gains = shades_of_grey(light_field.centre_view)
        light_field = replace(light_field, colour=replace(
            light_field.colour, gains=tuple(gains.tolist())))
    if calibration is None:
        save_npz(npz, views=light_field.views, weights=light_field.grid.weights,
                 positions=light_field.grid.positions)
        click.echo('no calibration: the views are lattice-aligned, their geometry is unknown',
                   err=True)
    else:
        write_npz(npz, light_field)
    write_png(centre, light_field.picture())
    rows, columns = light_field.grid.shape
    shown = light_field.colour.displayed(light_field.views[:, :, ::3, ::3], light_field.gamma)
    write_png(sheet, shown.transpose(0, 2, 1, 3, 4).reshape(
        rows * shown.shape[2], columns * shown.shape[3], 3))
    pinhole = light_field.grid.pinhole
    click.echo(f'{rows}x{columns} views of {pinhole.width}x{pinhole.height} in {out}', err=True)
    if ideal is not None:
        aligned = decoder.calibration.model_copy(update={'focus_distance': math.inf})
        found = Decoder(aligned, decoder.light, views, size).decode(frame)
        click.echo(table(compare_views(found, ideal)))
