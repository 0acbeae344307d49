"""`pmcl lattice`: the lattice of the lenslets, from a white image or an ordinary picture."""

from pathlib import Path

import click
import numpy as np

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.mosaic_image import is_mosaic_image, read_mosaic_image
from pmcl_ros.cli.base import FOLDER, FORCE, RAW, STDERR, results_in
from pmcl_ros.drawing.lattice_picture import lattice_picture
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.lightfield.calibration.lytro.lattice import predicted_lattice
from pmcl_ros.lightfield.calibration.lytro.lattice_fit import fit_lattice, lattice_from_picture
from pmcl_ros.lightfield.white_image import is_white_image, unevenness
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.warm_up.raw import UNPACK
from pmcl_ros.warm_up.stage import compile_ahead


@click.command()
@click.argument('raw', type=RAW)
@click.option('-o', '--out', required=True, type=FOLDER,
              help='Folder for lattice.yaml, lattice.png.')
@click.option('--as', 'kind', type=click.Choice(['white', 'picture']),
              help='Kind of RAW; default: detected.')
@click.option('--gain', type=float, default=1.0, show_default=True,
              help='Of a PNG or JPEG: factor applied to its intensity.')
@FORCE
def lattice(raw: Path, out: Path, kind: str | None, gain: float, force: bool) -> None:
    """Estimate the lattice of lenslets from RAW: a white image, or a picture if there is none.

    RAW: .RAW or .RAW.xz with its .TXT, .LFP, or the sensor's mosaic as an 8-bit PNG or JPEG.
    """
    results = results_in(out, force)
    values, drawing = map(results.path, ('lattice.yaml', 'lattice.png'))
    if gain != 1 and not is_mosaic_image(raw):
        raise click.UsageError(f'{raw} is no PNG or JPEG: --gain is for these')
    compile_ahead(STDERR, () if is_mosaic_image(raw) else UNPACK)
    frame = read_mosaic_image(raw, gain) if is_mosaic_image(raw) else read_raw_frame(raw)
    if kind is None:
        kind = 'white' if is_white_image(frame) else 'picture'
        marked = frame.metadata.tags.modulationFrame
        why = (f'its light is uneven by {100 * unevenness(frame):.1f} %' if marked is None
               else f'its metadata say modulationFrame: {str(marked).lower()}')
    else:
        why = 'by --as'
    click.echo(f'{raw.name} taken as {"white image" if kind == "white" else kind} ({why})')
    fit = fit_lattice(frame) if kind == 'white' else lattice_from_picture(frame)
    found = fit.lattice
    click.echo(f'pitch {found.pitch_px:.5f} px, row step {found.row_step_px:.5f} px, rotation '
               f'{found.rotation:.6f} rad, a centre at ({found.centre_px[0]:.3f}, '
               f'{found.centre_px[1]:.3f})')
    click.echo(f'measured centres about it: median {fit.median_px:.3f} px, 95 % within '
               f'{fit.p95_px:.3f} px; {fit.lenslets} lenslets; shear {fit.shear:.1e} rad left out')
    try:
        predicted = predicted_lattice(frame.metadata)
    except SettingsError as error:
        click.echo(f'the metadata say no lattice: {error}')
        predicted = None
    if predicted is not None:
        height, width = frame.counts.shape
        apart = found.difference(predicted, width, height)
        click.echo(f'the metadata say pitch {predicted.pitch_px:.5f} px, row step '
                   f'{predicted.row_step_px:.5f} px, rotation {predicted.rotation:.6f} rad: '
                   f'their centres are off by {np.median(apart):.2f} px (median)')
    found.save(values, f'From {raw.name}, a {kind} (pmcl lattice): {fit.lenslets} '
               f'lenslets, measured centres within {fit.p95_px:.3f} px (95 %).')
    write_png(drawing, lattice_picture(frame, fit))
    click.echo(f'lattice.yaml and lattice.png in {out}', err=True)
