"""`pmcl bag`: MCAP bags of the topics between the nodes."""

from pathlib import Path

import click

from pmcl_ros.cli.base import FOLDER, PATH
from pmcl_ros.lightfield.readers.read import is_light_field, read_light_field
from pmcl_ros.messages.bag_captures import extract_captures, record_capture, record_light_field


@click.group()
def bag() -> None:
    """MCAP bags of the topics between the nodes."""


@bag.command('record')
@click.argument('source', type=PATH)
@click.argument('folder', type=FOLDER)
@click.option('--every', type=click.IntRange(1), default=1, metavar='K',
              help='Of a light field: each K-th view alone.')
@click.option('--shrink', type=click.IntRange(1), default=1, metavar='N',
              help='Of a light field: make NxN pixels one.')
def bag_record(source: Path, folder: Path, every: int, shrink: int) -> None:
    """Make the bag FOLDER from SOURCE.

    From a raw picture: what lytro_driver would publish for it. From a light field (as `pmcl
    localize` takes): what subaperture_node would.
    """
    if is_light_field(source):
        record_light_field(read_light_field(source, every, shrink), folder)
    else:
        record_capture(source, folder)


@bag.command('extract')
@click.argument('bag_folder', metavar='BAG', type=click.Path(exists=True, path_type=Path))
@click.argument('folder', type=FOLDER)
def bag_extract(bag_folder: Path, folder: Path) -> None:
    """Write the raw pictures of BAG into FOLDER, as RAW and TXT."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in extract_captures(bag_folder, folder):
        click.echo(path, err=True)
