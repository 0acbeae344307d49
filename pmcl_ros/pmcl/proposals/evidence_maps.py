"""Maps of the evidence in cells, by direction: what templates are correlated with."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_map import ContourMap, harmonics
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.proposals.branch_and_bound import BLOCK, MARGIN, blocks_of, strips_of
from pmcl_ros.pmcl.proposals.templates import DIRECTIONS

CELL = 4  # image px: the step of places
_BLUR = 2.0  # image px: smoothing of the edge energy, so that a contour a cell off still counts
# Weight of the energy outside a contour relative to that on it: about that of the profile.
_OUTSIDE = 0.5
_LOG_ODDS = -1.0, 2.0  # half the log odds that a point of a template counts at least and most
UNIT = 255  # of evidence in 16-bit integers: 64 points of 2 at most fit


@dataclass(frozen=True)
class Origins:
    """Cells where the origin may be seen at a depth.

    depth: [m]. scale: of the templates there. reach: of these [cells]. rows, columns: of cells.
    """

    depth: float
    scale: float
    reach: int
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]


@dataclass(frozen=True)
class PaddedMaps:
    """Evidence maps as templates are summed in them, wherever their origin is.

    strips: as of `strips_of`. blocks: as of `blocks_of`, of maps with room around them, so that
    all templates lie in them. top, left: cells of these before the image.
    """

    strips: NDArray[np.int16]
    blocks: NDArray[np.int16]
    top: int
    left: int

    @classmethod
    def around(cls, maps: NDArray[np.int16], origins: Sequence[Origins]) -> 'PaddedMaps':
        """maps: (directions, rows, columns) of cells."""
        pads = []
        for size, cells in zip(maps.shape[1:], ([each.rows for each in origins],
                                                [each.columns for each in origins]), strict=True):
            ends = [(int(of[0]) - each.reach, int(of[-1]) + each.reach)
                    for each, of in zip(origins, cells, strict=True)]
            pads.append((max(0, -min(first for first, _ in ends)),
                         max(0, max(last for _, last in ends) + 1 + MARGIN - size)))
        # Around the image there is no evidence either way.
        return cls(strips_of(maps), blocks_of(maps, *pads), pads[0][0], pads[1][0])

    def blocks_about(self, origins: Origins) -> tuple[NDArray[np.int16], int, int]:
        """The blocks that templates reach from cells; row and column of the first of these there.

        Bounds of all that lies between the reached blocks of a row are summed too.
        """
        row, column = int(origins.rows[0]) + self.top, int(origins.columns[0]) + self.left
        above, before = ((first - origins.reach) // BLOCK for first in (row, column))
        below = -(-(row + len(origins.rows) + origins.reach) // BLOCK)
        after = -(-(column + len(origins.columns) + origins.reach) // BLOCK)
        part = self.blocks[..., above:below, before:after]
        return np.ascontiguousarray(part), row - BLOCK * above, column - BLOCK * before


def whole_cells(shape: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of cells in an image of a shape (height, width, ...)."""
    return max(1, shape[0] // CELL), max(1, shape[1] // CELL)


def _cells_at(volume: EvidenceVolume, depth: float) -> tuple[NDArray[np.float32], int, int]:
    """The tensor at a depth, of whole cells; rows and columns of cells."""
    last = volume.tensor.shape[2] - 1
    label = np.clip(volume.labels(depth), 0, last)
    below = int(label)
    part = np.float32(label - below)
    tensor = volume.tensor[:, :, below]
    if part:
        tensor = (1 - part) * tensor + part * volume.tensor[:, :, below + 1]
    height, width = whole_cells(tensor.shape)
    return tensor[:height * CELL, :width * CELL], height, width


def maps_at(volume: EvidenceVolume, depth: float) -> NDArray[np.int16]:
    """(directions, rows, columns) of cells: what templates are correlated with."""
    return (_log_odds_maps(volume, depth) if isinstance(volume, ContourMap)
            else _evidence_maps(volume, depth))


def _evidence_maps(volume: EvidenceVolume, depth: float) -> NDArray[np.int16]:
    """(directions, rows, columns) of cells, in units of 1 / 255.

    Edge energy on a contour of each normal there, less half of that outside it.
    """
    whole, height, width = _cells_at(volume, depth)
    cells = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    # A cell's mean is a part of the blur.
    tensor = cv2.GaussianBlur(cells, (0, 0), (_BLUR ** 2 - (CELL ** 2 - 1) / 12) ** 0.5 / CELL)
    maps = np.zeros((DIRECTIONS, height, width), np.int16)
    for k, angle in enumerate(2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS):
        nx, ny = np.cos(angle), np.sin(angle)
        across = tensor @ np.array([nx * nx, ny * ny, 2 * nx * ny], np.float32)
        energy = np.sqrt(np.maximum(across, 0))
        outside = np.zeros_like(energy)
        for distance in (3.0, 4.5, 6.0):
            step = distance * _BLUR / CELL
            move = np.array([[1, 0, -step * nx], [0, 1, -step * ny]])
            outside += cv2.warpAffine(energy, move, (width, height),
                                      borderMode=cv2.BORDER_REPLICATE) / 3
        maps[k] = np.rint(UNIT * (np.minimum(energy, 2) - _OUTSIDE * np.minimum(outside, 2)))
    return maps


def _log_odds_maps(odds: ContourMap, depth: float) -> NDArray[np.int16]:
    """As `_evidence_maps`: log odds of a contour of each normal somewhere in a cell, halved."""
    tensor, height, width = _cells_at(odds, depth)
    maps = np.zeros((DIRECTIONS, height, width), np.int16)
    for k, each in enumerate(harmonics(2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)):
        ratio = cv2.resize(np.exp(tensor @ each), (width, height), interpolation=cv2.INTER_AREA)
        ratio = cv2.GaussianBlur(ratio, (0, 0), _BLUR / CELL)
        maps[k] = np.rint(UNIT * np.clip(np.log(ratio) / 2, *_LOG_ODDS))
    return maps
