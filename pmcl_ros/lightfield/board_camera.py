"""Where a camera is, by the printed board that its picture shows."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.fixed_cameras import CameraAtBoard, camera_at_board
from pmcl_ros.lightfield.calibration.printed_board import (
    Board,
    another_lens,
    as_it_lies,
    reduction_for,
)
from pmcl_ros.lightfield.readers.pictures import Bits
from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.lightfield.view_fields import Compressed, Rectified, Reliable
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.runtime.settings import Settings

_SIDES = 4  # more take longer and tell little
_ALIKE = np.cos(np.deg2rad(15))  # of two sights of one side: nearer ones tell the same


class BoardNodeSettings(Settings):
    """Images of a camera that sees a printed board -> its poses in the frame of the board."""

    ring: str = Field('8x11', description='squares along the sides of a ring of markers '
                      '(pmcl board --ring); the frame is its middle, z out of it')
    corners: str = Field('', description='in place of a ring, inner corners of a checkerboard '
                         '(pmcl board --corners), as 10x7; the frame is its first corner, z into '
                         'the board; empty: it is a ring')
    square: float = Field(0.024, gt=1e-4, lt=1, description='side of the squares [m]')
    fixed_frame: str = Field('board', min_length=1, description='frame of the board')
    compressed: Compressed = False
    rectified: Rectified = False
    reliable: Reliable = True
    broadcast_tf: bool = Field(False, description="publish the board as a child of the camera's "
                               'frame on /tf, so that its frame is one of the robot')
    bits: Bits = 16

    @property
    def board(self) -> Board:
        """Raises SettingsError for numbers that no board has, or that do not tell its turn."""
        if not self.corners:
            return CharucoRing.parse(self.ring, self.square)
        board = Checkerboard.parse(self.corners, self.square)
        board.check_turn()
        return board


class _Side(NamedTuple):
    """corners: (m, 2) [px], as of the board's `seen`. sight: (3,) unit vector to the camera."""

    corners: NDArray[np.float64]
    sight: NDArray[np.float64]


class CameraByBoard(NamedTuple):
    """at: where the camera is. lens: as of `another_lens`."""

    at: CameraAtBoard
    lens: str | None


class BoardCamera:
    """A camera that sees a board, picture by picture; the board rests.

    Paper is bent: how, pictures from several sides tell together, so that the last ones count.
    """

    def __init__(self, board: Board) -> None:
        self._board = board
        self._lens: Lens | None = None
        self._sides: list[_Side] = []

    def find(self, picture: NDArray[np.uint8], lens: Lens, name: str) -> CameraByBoard:
        """Where the camera is that took a grey picture (height, width).

        The picture is of the lens's size. A large one is shrunk; distances of corners are in
        pixels of what it becomes. name: of the picture.
        Raises LightFieldError where it does not show the board, or does not tell the pose.
        """
        if lens != self._lens:
            self._lens = lens
            self._sides.clear()
        reduction = reduction_for(lens.pinhole.width, lens.pinhole.height)
        pinhole = reduction.pinhole(lens.pinhole)
        shrunk = reduction.shrunk(picture.astype(np.float32) / np.float32(255))
        plain = replace(lens, pinhole=pinhole).undistorted(shrunk, pinhole)
        seen = self._board.seen(np.rint(255 * plain).astype(np.uint8))
        if seen is None:
            raise LightFieldError(f'{name} does not show the board {self._board.options}')
        before = {f'{name}, {number} sides before': each.corners
                  for number, each in enumerate(self._sides)}
        try:
            found = self._found(before | {name: seen}, name, pinhole)
        except LightFieldError:
            if not before:
                raise
            found = self._found({name: seen}, name, pinhole)
            self._sides.clear()  # the board is another one, or bent otherwise
        self._remember(seen, found.at.camera)
        return found

    def _found(self, seen: dict[str, NDArray[np.float64]], name: str, pinhole: Pinhole
               ) -> CameraByBoard:
        """By the picture of a name, and the bend that all tell together; as `find`."""
        points, heights, boards = as_it_lies(self._board, seen, pinhole)
        if name not in boards:
            raise LightFieldError(f'{name} does not show the board {self._board.options}')
        at = camera_at_board({name: boards[name]}, points, pinhole, heights)
        return CameraByBoard(at, another_lens(boards, self._board, pinhole))

    def _remember(self, corners: NDArray[np.float64], camera: NDArray[np.float64]) -> None:
        """The corners, in place of those that were seen from the same side; camera: (4, 4)."""
        sight = camera[:3, 3] - self._board.points.mean(axis=0)
        sight /= np.linalg.norm(sight)
        others = [each for each in self._sides if each.sight @ sight < _ALIKE]
        self._sides = [*others, _Side(corners, sight)][-_SIDES:]
