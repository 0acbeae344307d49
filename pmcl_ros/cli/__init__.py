"""`pmcl ...`: the same core as the nodes, without ROS."""

import logging

import click
from rich.logging import RichHandler

from pmcl_ros import __version__
from pmcl_ros.cli.base import STDERR, Commands

# By section of `pmcl --help`: the module below pmcl_ros.cli of each command, and what it does.
_SECTIONS = {
    'Find objects': {
        'localize': ('localize', "Find an object's pose in pictures."),
        'report': ('report', 'Find it, and write a page that shows how sure the pose is.'),
        'next-view': ('next_view', 'From where one more picture helps most.'),
        'grasps': ('grasps', 'Make grasps for an object.'),
        'profile': ('profile', 'Measure a vessel without CAD in posed views.'),
    },
    'Cameras and data': {
        'bag': ('bag', 'Record and extract MCAP bags.'),
        'calibrate': ('cameras.calibrate', 'Calibrate a Lytro from pictures of a checkerboard.'),
        'camera': ('cameras.camera', 'A Lytro on the network, and a simulated one.'),
        'decode': ('decode', 'Decode a raw picture into views.'),
        'handeye': ('cameras.hand_eye', "Fit the pose of a camera on an arm's link."),
        'lattice': ('cameras.lattice', 'Draw the lenslets of a raw picture.'),
        'lfp': ('cameras.lfp', "Lytro's container files."),
        'sweep': ('cameras.sweep', 'Plan the motion of an ordinary camera on an arm.'),
    },
    'Simulate': {
        'feasibility': ('simulations.feasibility', 'Will it work for my object and camera?'),
        'manipulate': ('simulations.manipulate', 'A simulated arm takes an object out of water.'),
        'scenes': ('simulations.scenes', 'Generated scenes with truth.'),
        'simulate': ('simulations.simulate', 'Scenes with your object, path-traced or fast.'),
    },
    'Evaluate and develop': {
        'bench': ('bench', 'Times of the stages.'),
        'calibration-from-truth': ('cameras.calibrate', 'The calibration of simulated captures.'),
        'coverage': ('studies', 'How often credible regions hold the truth.'),
        'evaluate': ('evaluate', 'Errors over captures with truth.'),
        'figures': ('studies', "The documentation's figures."),
        'learn': ('learn', 'Learn the numbers of the evidence.'),
        'learn-map': ('learn_map', 'Train the network of the contour map.'),
        'profile-errors': ('studies', 'Errors of measured vessels.'),
        'together': ('studies', 'Several objects together against one by one.'),
        'track': ('studies', 'Tracking against single captures.'),
        'view-gain': ('studies', 'What a next view brings.'),
    },
    'This machine': {
        'doctor': ('doctor', 'Check packages, OpenGL, memory, camera.'),
        'warm-up': ('warm_up', 'Compile the kernels ahead.'),
    },
}


@click.group(cls=Commands, sections=_SECTIONS)
@click.version_option(__version__)
@click.option('--verbose', is_flag=True, help='Print the choices made (renderer, symmetry, ...).')
def main(verbose: bool) -> None:
    """Find a known, possibly transparent object in a light field, or in pictures."""
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format='%(message)s',
                        handlers=[RichHandler(console=STDERR, show_path=False)])
