"""Corners of a checkerboard in the pictures that a views.yaml lists."""

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator
from rich.progress import track

from pmcl_ros.cli.base import STDERR
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.boards import Checkerboard
from pmcl_ros.lightfield.readers import posed_views
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.runtime.errors import LightFieldError


class RestingCameras(posed_views.ViewsFile):
    """views.yaml of cameras and a board that rest: no view has a pose."""

    @model_validator(mode='after')
    def _whole(self) -> 'RestingCameras':
        for each in self.views:
            if each.camera not in self.cameras:
                raise ValueError(f'{each.file} is of the camera {each.camera!r}, cameras has '
                                 f'{", ".join(self.cameras) or "none"}')
            if each.mount_to_base is not None:
                raise ValueError(f'{each.file} has mount_to_base, a pose of an arm: say '
                                 '--fixed-camera in place of --no-robot, or leave it out')
        return self


def boards_in(of: posed_views.ViewsFile, path: Path, board: Checkerboard, reduction: Reduction,
              pinholes: set[Pinhole]) -> dict[str, NDArray[np.float64]]:
    """Corners (m, 2) [px] in the pictures with a complete board; others are named.

    pinholes: of all pictures, more than one is refused; those of light fields are added.
    """
    found = {}
    for entry in track(of.views, console=STDERR, description='boards', transient=True):
        # One at a time: corners are small, all pictures at once need not fit in memory.
        view, = posed_views.views_of(of.model_copy(update={'views': [entry]}), path.parent,
                                     f'{path}: {entry.file}', reduction)
        pinholes.add(view.pinhole)  # a light field has its own
        check_one(path, pinholes)
        seen = board.seen(view.displayed().mean(axis=2).astype(np.uint8))
        if seen is None:
            click.echo(f'{entry.file}: no complete board', err=True)
            continue
        found[entry.file] = seen
    return found


def check_one(path: Path, pinholes: set[Pinhole]) -> None:
    """Raise LightFieldError for pictures of several cameras."""
    if len(pinholes) > 1:
        raise LightFieldError(f'{path} has pictures of {len(pinholes)} cameras; give those of one')
