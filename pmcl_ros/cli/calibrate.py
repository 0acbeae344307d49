"""`pmcl calibration-from-truth`: a simulated camera's calibration."""

from pathlib import Path

import click

from pmcl_ros.cli.base import FILE
from pmcl_ros.lightfield.calibration import Calibration


@click.command('calibration-from-truth')
@click.argument('capture', type=FILE)
@click.argument('white', type=FILE)
@click.option('--serial', default='', help='Serial number of the camera.')
@click.option('--out', required=True, type=click.Path(dir_okay=False, path_type=Path))
def calibration_from_truth(capture: Path, white: Path, serial: str, out: Path) -> None:
    """Write the calibration of simulated captures from their truth.json files.

    That of a CAPTURE and that of the WHITE image.
    """
    Calibration.from_truth(capture, white, serial).save(
        out, "Of a simulated camera, from its captures' truth files "
        '(pmcl calibration-from-truth).')
