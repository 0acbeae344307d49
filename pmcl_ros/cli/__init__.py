"""`pmcl ...`: the same core as the nodes, without ROS."""

import logging

import click

from pmcl_ros import __version__
from pmcl_ros.cli.base import Commands
from pmcl_ros.cli.log import TerminalLog

# By section of `pmcl --help`: the module below pmcl_ros.cli of each command, and what it does.
_SECTIONS = {
    'Find objects': {
        'localize': ('localize', "Find an object's pose in pictures."),
        'report': ('report', 'Find it, and write a page that shows how sure the pose is.'),
        'contour-map': ('contour_map', 'Draw what the search sees in a picture of any camera.'),
        'next-view': ('next_view', 'Say from where one more picture helps most.'),
        'grasps': ('grasps', 'Make grasps for an object.'),
        'profile': ('profile', 'Measure a vessel without CAD in posed views.'),
    },
    'Cameras and data': {
        'bag': ('bag', 'Record and extract MCAP bags.'),
        'board': ('cameras.board', 'Draw a checkerboard, or a ring, to print.'),
        'board-poses': ('cameras.board', 'Write camera poses by such a board in the pictures.'),
        'calibrate': ('cameras.calibrate', 'Calibrate a Lytro from pictures of a checkerboard.'),
        'calibrate-camera': ('cameras.board', 'Calibrate an ordinary camera from such pictures.'),
        'camera': ('cameras.camera', 'Use a Lytro on the network, or simulate one.'),
        'decode': ('decode', 'Decode a raw picture into views.'),
        'handeye': ('cameras.hand_eye', "Fit the pose of a camera on an arm's link."),
        'lattice': ('cameras.lattice', 'Draw the lenslets of a raw picture.'),
        'lfp': ('cameras.lfp', "Pack and unpack Lytro's container files."),
        'sweep': ('cameras.sweep', 'Plan the motion of an ordinary camera on an arm.'),
    },
    'Simulate': {
        'compare': ('simulations.compare', 'Compare two studies of feasibility, cell by cell.'),
        'feasibility': ('simulations.feasibility',
                        'Tell whether it will work for your object and camera.'),
        'manipulate': ('simulations.manipulate',
                       'Let a simulated arm take an object out of water.'),
        'scenes': ('simulations.scenes', 'Generate scenes with truth.'),
        'simulate': ('simulations.simulate',
                     'Simulate scenes with your object, path-traced or fast.'),
    },
    'Evaluate and develop': {
        'bench': ('bench', 'Measure the times of the stages.'),
        'calibration-from-truth': ('cameras.calibrate',
                                   'Write the calibration of simulated captures.'),
        'coverage': ('studies', 'Measure how often credible regions hold the truth.'),
        'evaluate': ('evaluate', 'Measure errors over captures with truth.'),
        'figures': ('studies', "Draw the documentation's figures."),
        'learn': ('learning.learn', 'Learn the numbers of the evidence.'),
        'learn-map': ('learning.learn_map', 'Train the network of the contour map.'),
        'measure-map': ('learning.learn_map', 'Measure that network on labelled pictures.'),
        'profile-errors': ('studies', 'Measure the errors of profiled vessels.'),
        'together': ('studies', 'Compare joint with single searches of several objects.'),
        'track': ('studies', 'Compare tracking with single captures.'),
        'view-gain': ('studies', 'Measure what a next view brings.'),
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
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING,
                        handlers=[TerminalLog()])
