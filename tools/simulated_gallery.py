"""Tumblers of several materials in several places, path-traced: docs/figures/simulated.png.

    .venv/bin/python tools/simulated_gallery.py docs/figures/simulated.png
"""

import tempfile
from pathlib import Path

import click
import cv2
import yaml

from pmcl_ros.cli import main as pmcl
from pmcl_ros.drawing.pictures import contact_sheet
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.runtime.text_file import read_yaml_file

CAMERA = {'width': 320, 'height': 240, 'fx': 420.0, 'cx': 159.5, 'cy': 119.5, 'noise': 0.003}
SAMPLES, SEED = 128, 3
PICTURES = (  # place, and what differs from clear glass: three rows of three
    ('table', {}), ('clutter', {'material': 'acrylic'}), ('shelf', {'material': 'pet'}),
    ('clutter', {'material': 'frosted'}), ('table', {'material': 'tinted'}),
    ('table', {'material': 'opaque', 'colour': [0.1, 0.2, 0.5]}),
    ('table', {'liquid': {'level': 0.06}}), ('sink', {}), ('tank', {}))


@click.command()
@click.argument('out', type=click.Path(dir_okay=False, path_type=Path))
def main(out):
    """Draw the gallery."""
    tumbler = resolve('package://pmcl_ros/config/objects/tumbler.yaml', 'object')
    described = read_yaml_file(tumbler)
    with tempfile.TemporaryDirectory() as folder:
        here, pictures = Path(folder), []
        (here / 'camera.yaml').write_text(yaml.safe_dump(CAMERA))
        for number, (place, look) in enumerate(PICTURES):
            thing = here / f'{number}.yaml'
            thing.write_text(yaml.safe_dump({
                'mesh': str(tumbler.parent / described['mesh']),
                'appearance': described['appearance'] | look}))
            far = '0.55:0.6' if place == 'tank' else '0.34:0.36'
            pmcl(['simulate', str(thing), '--camera', str(here / 'camera.yaml'), '--region', far,
                  '--surroundings', place, '--attitude', 'upright', '--samples', str(SAMPLES),
                  '--count', '1', '--seed', str(SEED + number), '-o', str(here / f'{number}')],
                 standalone_mode=False)
            pictures.append(cv2.imread(str(next((here / f'{number}').glob('*/view.png')))))
    cv2.imwrite(str(out), contact_sheet(pictures), [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == '__main__':
    main()
