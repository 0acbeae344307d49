"""Views of real first-generation Lytro pictures that came as mosaic images, without a white image.

    .venv/bin/python tools/real_gallery.py MOSAIC... --gain 1.5 --out docs/figures/real_mosaics.png

For each mosaic: the centre view; a detail of the leftmost, centre and rightmost view of the middle
row; one image row through the nine views of that row, from top to bottom. Lattice and light under
a lenslet are estimated from the picture itself, so is the white balance (shades of grey); colour
matrix and gamma are the model's.
"""

from dataclasses import replace
from pathlib import Path

import click
import cv2
import numpy as np

from pmcl_ros.camera.mosaic_image import read_mosaic_image
from pmcl_ros.lightfield.colour import shades_of_grey
from pmcl_ros.lightfield.decoders import uncalibrated_decoder

MIDDLE, LEFT, RIGHT = 4, 0, 8  # of the 9x9 views
BRIGHT = 99.5  # percent of the pixels that are not clipped
STRETCH = 5  # px drawn for each view in the strip
DETAIL = 49  # px, height of a detail


@click.command()
@click.argument('mosaics', nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option('--gain', default=1.0, help="What the mosaics' intensity was multiplied by.")
@click.option('--out', required=True, type=click.Path(dir_okay=False, path_type=Path))
def main(mosaics, gain, out):
    """Draw the gallery."""
    picture = np.hstack([panel(path, gain) for path in mosaics])
    cv2.imwrite(str(out), picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])


def panel(path, gain):
    """(height, 332, 3) of one mosaic."""
    views = middle_row(path, gain)
    centre = views[MIDDLE]
    width = centre.shape[1]
    top, left = busiest(views, width // 3)
    details = np.hstack([views[k][top:top + DETAIL, left:left + width // 3]
                         for k in (LEFT, MIDDLE, RIGHT)])
    details = np.pad(details, ((0, 0), (0, width - details.shape[1]), (0, 0)), mode='edge')
    strip = np.repeat(views[:, top + DETAIL // 2], STRETCH, axis=0)
    rows = [centre, details, strip]
    rim = np.full((4, width, 3), 255, np.uint8)
    picture = np.vstack([part for row in rows for part in (row, rim)][:-1])
    return np.pad(picture, ((0, 0), (0, 4), (0, 0)), constant_values=255)


def middle_row(path, gain):
    """(9, height, width, 3) uint8: the views of the middle row, to look at."""
    frame = read_mosaic_image(path, gain)
    decoder = uncalibrated_decoder(frame)
    light_field = decoder.decode(frame)
    views = light_field.views[MIDDLE]
    gains = shades_of_grey(views[MIDDLE])
    click.echo(f'{path.name}: white balance estimated, red {gains[0]:.2f}, blue {gains[2]:.2f}')
    colour = replace(light_field.colour, gains=tuple(gains.tolist()))
    brightest = np.percentile(views[MIDDLE].max(axis=-1), BRIGHT)
    return colour.displayed(np.minimum(views / brightest, 1), light_field.gamma)


def busiest(views, width):
    """Row and column of the detail in which left and right view differ most."""
    apart = np.abs(views[LEFT].astype(float) - views[RIGHT]).mean(axis=-1)
    means = cv2.boxFilter(apart, -1, (width, DETAIL))
    inner = means[DETAIL // 2:-(DETAIL // 2) - 1, width // 2:-(width // 2) - 1]
    top, left = np.unravel_index(inner.argmax(), inner.shape)
    return int(top), int(left)


if __name__ == '__main__':
    main()
