"""`pmcl bag`: MCAP bags of the topics between the nodes."""

from pathlib import Path

import click

from pmcl_ros.bags import record_capture
from pmcl_ros.cli.base import FILE, FOLDER


@click.group()
def bag() -> None:
    """MCAP bags of the topics between the nodes."""


@bag.command('record')
@click.argument('raw', type=FILE)
@click.argument('folder', type=FOLDER)
def bag_record(raw: Path, folder: Path) -> None:
    """Make the bag FOLDER from RAW: what lytro_driver would publish for it."""
    record_capture(raw, folder)
