"""`pmcl ...`: the same core as the nodes, without ROS."""

import logging

import click
from rich.logging import RichHandler

from pmcl_ros import __version__
from pmcl_ros.cli.base import STDERR, Commands

_MODULES = {name: f'pmcl_ros.cli.{name}' for name in (
    'bag', 'bench', 'decode', 'doctor', 'evaluate', 'grasps', 'learn', 'localize', 'profile',
    'report')}
_MODULES |= {name: f'pmcl_ros.cli.cameras.{name}' for name in (
    'calibrate', 'camera', 'lattice', 'lfp', 'sweep')}
_MODULES |= {name: f'pmcl_ros.cli.simulations.{name}' for name in (
    'feasibility', 'manipulate', 'scenes', 'simulate')}
_MODULES |= dict.fromkeys(('coverage', 'figures', 'profile-errors', 'together', 'track',
                           'view-gain'),
                          'pmcl_ros.cli.studies')
_MODULES |= {'calibration-from-truth': 'pmcl_ros.cli.cameras.calibrate',
             'handeye': 'pmcl_ros.cli.cameras.hand_eye', 'learn-map': 'pmcl_ros.cli.learn_map',
             'next-view': 'pmcl_ros.cli.next_view', 'warm-up': 'pmcl_ros.cli.warm_up'}


@click.group(cls=Commands, modules=_MODULES)
@click.version_option(__version__)
@click.option('--verbose', is_flag=True, help='Print the choices made (renderer, symmetry, ...).')
def main(verbose: bool) -> None:
    """Find a known, possibly transparent object in a light field."""
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format='%(message)s',
                        handlers=[RichHandler(console=STDERR, show_path=False)])
