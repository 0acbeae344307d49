"""`pmcl ...`: the same core as the nodes, without ROS."""

import logging

import click
from rich.logging import RichHandler

from pmcl_ros import __version__
from pmcl_ros.cli.bag import bag
from pmcl_ros.cli.base import STDERR, Commands
from pmcl_ros.cli.bench import bench
from pmcl_ros.cli.calibrate import calibrate, calibration_from_truth
from pmcl_ros.cli.camera import camera
from pmcl_ros.cli.coverage import coverage, learn
from pmcl_ros.cli.decode import decode
from pmcl_ros.cli.doctor import doctor
from pmcl_ros.cli.evaluate import evaluate
from pmcl_ros.cli.figures import figures
from pmcl_ros.cli.grasps import grasps
from pmcl_ros.cli.lattice import lattice
from pmcl_ros.cli.lfp import lfp
from pmcl_ros.cli.localize import localize
from pmcl_ros.cli.report import report
from pmcl_ros.cli.scenes import scenes
from pmcl_ros.cli.sweep import sweep
from pmcl_ros.cli.together import together_command
from pmcl_ros.cli.track import track


@click.group(cls=Commands)
@click.version_option(__version__)
@click.option('--verbose', is_flag=True, help='Say what is chosen (renderer, symmetry, ...).')
def main(verbose: bool) -> None:
    """Where a transparent object is, from a light field."""
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format='%(message)s',
                        handlers=[RichHandler(console=STDERR, show_path=False)])


for _command in (decode, calibrate, calibration_from_truth, localize, evaluate, figures, bench,
                 bag, lattice, lfp, camera, doctor, scenes, grasps, coverage, learn, report,
                 sweep, track, together_command):
    main.add_command(_command)
