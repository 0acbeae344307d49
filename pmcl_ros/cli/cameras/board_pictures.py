"""The board that options tell of, and its corners in the pictures that a views.yaml lists."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator
from rich.progress import track

from pmcl_ros.cli.base import STDERR, with_options
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.printed_board import Board, LyingBoard, as_it_lies
from pmcl_ros.lightfield.readers import posed_views
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.runtime.errors import LightFieldError

RING = click.option('--ring', metavar='COLUMNSxROWS', help='In place of --corners: squares along '
                    'the sides of a ring of markers, as 8x11. An object may stand in its middle.')
ASK_LENS = 'is the calibration of this camera, resolution, zoom and focus?'
_OPTIONS = (
    click.option('--corners', metavar='COLUMNSxROWS', help='Inner corners of the checkerboard, as '
                 '10x7; one number odd, the other even.'),
    RING,
    click.option('--square', required=True, type=float, help='Side of its squares [m].'))


def board_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--corners, --ring and --square, as `board_of` reads them."""
    return with_options(_OPTIONS, command)


def board_of(corners: str | None, ring: str | None, square: float) -> Board:
    """Raises UsageError for none or both of corners and ring, SettingsError for no board."""
    if corners is not None and ring is None:
        return Checkerboard.parse(corners, square)
    if ring is not None and corners is None:
        return CharucoRing.parse(ring, square)
    asked = 'say what the board is' if corners is None else 'a board is one of the two'
    raise click.UsageError(f'{asked}: --corners, as 10x7, for a checkerboard, or --ring, as 8x11, '
                           'for a ring of markers')


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


def boards_in(of: posed_views.ViewsFile, path: Path, board: Board, reduction: Reduction,
              pinholes: set[Pinhole]) -> dict[str, NDArray[np.float64]]:
    """Corners (m, 2) [px] in the pictures that show the board, as its `seen`; others are named.

    pinholes: of all pictures, more than one is refused; those of light fields are added.
    """
    found = {}
    for entry in track(of.views, console=STDERR, description='boards', transient=True):
        # One at a time: corners are small, all pictures at once need not fit in memory.
        view, = posed_views.views_of(of.model_copy(update={'views': [entry]}), path.parent,
                                     f'{path}: {entry.file}', reduction)
        pinholes.add(view.pinhole)  # a light field has its own
        check_one(path, pinholes)
        grey = view.displayed().mean(axis=2).astype(np.uint8)
        seen = corners_in(grey, entry.file, board)
        if seen is not None:
            found[entry.file] = seen
    return found


def corners_in(picture: NDArray[np.uint8], file: str, board: Board) -> NDArray[np.float64] | None:
    """Corners (m, 2) [px] in a grey picture, as of `seen`; one without the board is named."""
    try:
        seen = board.seen(picture)
    except LightFieldError as error:
        click.echo(f'{file}: {error}', err=True)
        return None
    if seen is None:
        _name(file, board)
    return seen


def lying(board: Board, boards: Mapping[str, NDArray[np.float64]], pinhole: Pinhole) -> LyingBoard:
    """`as_it_lies`, of what `boards_in` gives; pictures of too few corners are named."""
    found = as_it_lies(board, boards, pinhole)
    for file in boards:
        if file not in found.pictures:
            _name(file, board)
    return found


def _name(file: str, board: Board) -> None:
    what = 'not enough of the ring' if isinstance(board, CharucoRing) else 'no complete board'
    click.echo(f'{file}: {what}', err=True)


def check_one(path: Path, pinholes: set[Pinhole]) -> None:
    """Raise LightFieldError for pictures of several cameras."""
    if len(pinholes) > 1:
        raise LightFieldError(f'{path} has pictures of {len(pinholes)} cameras; give those of one')
