"""`pmcl decode`: a raw picture's views, as NPZ and pictures."""

from pathlib import Path

import click
import numpy as np

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.cli.base import FOLDER, capture_options
from pmcl_ros.evaluation.pictures import write_png
from pmcl_ros.lightfield.calibration import Calibration
from pmcl_ros.lightfield.decode import Decoder


@click.command()
@capture_options
@click.option('--out', required=True, type=FOLDER, help='Folder for views.npz and pictures.')
def decode(raw: Path, calibration: Path, white: Path, out: Path) -> None:
    """Decode RAW (.RAW or .RAW.xz with its .TXT) into rectified views: NPZ and PNG."""
    decoder = Decoder(Calibration.load(calibration), read_raw_frame(white))
    light_field = decoder.decode(read_raw_frame(raw))
    out.mkdir(parents=True, exist_ok=True)
    pinhole = light_field.grid.pinhole
    np.savez_compressed(out / 'views.npz', views=light_field.views, fx=pinhole.fx, fy=pinhole.fy,
                        cx=pinhole.cx, cy=pinhole.cy, baseline=light_field.grid.baseline,
                        weights=light_field.grid.weights, positions=light_field.grid.positions)
    write_png(out / 'centre.png', light_field.picture())
    rows, columns = light_field.grid.shape
    shown = np.clip(light_field.views[:, :, ::3, ::3], 0, 1) ** light_field.gamma
    mosaic = shown.transpose(0, 2, 1, 3, 4).reshape(rows * shown.shape[2],
                                                    columns * shown.shape[3], 3)
    write_png(out / 'views.png', np.round(255 * mosaic).astype(np.uint8))
    click.echo(f'{rows}x{columns} views of {pinhole.width}x{pinhole.height} in {out}', err=True)
