"""`pmcl ...`: the same core as the nodes, without ROS."""

import logging

import click
from rich.logging import RichHandler

from pmcl_ros import __version__
from pmcl_ros.cli.bag import bag
from pmcl_ros.cli.base import STDERR, Commands
from pmcl_ros.cli.bench import bench
from pmcl_ros.cli.calibrate import calibration_from_truth
from pmcl_ros.cli.decode import decode
from pmcl_ros.cli.evaluate import evaluate
from pmcl_ros.cli.localize import localize


@click.group(cls=Commands)
@click.version_option(__version__)
@click.option('--verbose', is_flag=True, help='Say what is chosen (renderer, symmetry, ...).')
def main(verbose: bool) -> None:
    """Where a transparent object is, from a light field."""
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format='%(message)s',
                        handlers=[RichHandler(console=STDERR, show_path=False)])


for _command in (decode, calibration_from_truth, localize, evaluate, bench, bag):
    main.add_command(_command)
