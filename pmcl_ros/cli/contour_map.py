"""`pmcl contour-map`: draw what the evidence is in pictures of any camera."""

from collections import Counter
from pathlib import Path

import click
import numpy as np

from pmcl_ros.cli.base import FILE, FOLDER, FORCE, results_in
from pmcl_ros.drawing.contour_map_picture import contour_map_picture
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.evidence.contour_net import contour_net, reduced
from pmcl_ros.lightfield.posed_view import GAMMA, encoded
from pmcl_ros.lightfield.readers.pictures import read_picture
from pmcl_ros.runtime.errors import PictureError, told_as


@click.command('contour-map')
@click.argument('pictures', type=FILE, nargs=-1, required=True)
@click.option('-o', '--out', type=FOLDER, required=True, help='Folder; a PNG for each picture.')
@FORCE
def contour_map(pictures: tuple[Path, ...], out: Path, force: bool) -> None:
    """Draw occluding contours and the inside of solids as the search sees them.

    PICTURES are of any camera: no calibration, mesh or pose is needed. A contour is as bright as
    its log odds, coloured by its direction. An object of which too little shows here will not be
    found.
    """
    names = [f'{each.stem}_contours.png' for each in pictures]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise click.UsageError(f'{twice[0]} would be of two pictures: rename one, or draw them '
                               'into two folders')
    results = results_in(out, force)
    results.reserve(*names)
    net = contour_net()
    for path, name in zip(pictures, names, strict=True):
        # Before the network, which gives its map in all pixels; means of white may be 1.0000001.
        picture = reduced(encoded(read_picture(path), GAMMA)).clip(0, 1)
        with told_as(PictureError, name=path):
            ratios = net(picture)
        file = results.path(name)
        write_png(file, contour_map_picture(np.rint(255 * picture).astype(np.uint8), ratios))
        click.echo(file)
