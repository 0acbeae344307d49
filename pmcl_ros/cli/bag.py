"""`pmcl bag`: MCAP bags of the topics between the nodes."""

from pathlib import Path

import click

from pmcl_ros.cli.base import FOLDER, FORCE, STDERR, Needed
from pmcl_ros.cli.sources import GivenSource, posed_options
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.read import is_light_field, pictures_alone
from pmcl_ros.messages.bag_captures import (
    extract_captures,
    record_capture,
    record_light_field,
    record_posed_views,
)
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.warm_up.raw import UNPACK
from pmcl_ros.warm_up.stage import compile_ahead

_NEEDED = ('a bag is of light fields or posed views; write a views.yaml with camera_to_reference')


@click.group()
def bag() -> None:
    """MCAP bags of the topics between the nodes."""


@bag.command('record')
@posed_options
@click.argument('folder', type=FOLDER)
def bag_record(source: GivenSource, folder: Path) -> None:
    """Make the bag FOLDER from SOURCE.

    From a raw picture: what lytro_driver would publish for it. From a light field (as `pmcl
    localize` takes): what subaperture_node would. From posed views: what sweep_driver would.
    """
    if not is_light_field(source.source):
        source.check_of_raw()
        compile_ahead(STDERR, UNPACK)
        record_capture(source.source, folder)
        return
    if pictures_alone(source.source):
        raise LightFieldError(f'{source.source} has no poses of its cameras (cam_R_w2c, '
                              f'cam_t_w2c): {_NEEDED} (docs/howto/posed_views.md); pmcl localize '
                              'takes the pictures alone')
    made = source.open().read()
    if isinstance(made, LightField):
        record_light_field(made, folder)
    elif isinstance(made, PosedViews):
        record_posed_views(made, folder)
    else:
        raise LightFieldError(f'{source.source} is one picture without the pose of its camera: '
                              f'{_NEEDED} (of one picture the unit matrix will do)')


@bag.command('extract')
@click.argument('bag_folder', metavar='BAG', type=Needed(
    'pmcl_record and pmcl bag record make bags: docs/howto/bags.md', folder=True))
@click.argument('folder', type=FOLDER)
@FORCE
def bag_extract(bag_folder: Path, folder: Path, force: bool) -> None:
    """Write the raw pictures of BAG into FOLDER, as RAW and TXT."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in extract_captures(bag_folder, folder, force):
        click.echo(path, err=True)
