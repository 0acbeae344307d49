"""Proposals: an exhaustive search over orientation, depth and place on coarse contours.

Uniform particles rarely fall into the basin of the pose (1e-5 of the region). Relative to its own
line of sight an object has the same outline anywhere in the image, up to scale. So a template of
each orientation is rendered once, scaled to each depth, and correlated with maps of the contour
evidence.
"""

from copy import copy
from dataclasses import dataclass

import cv2
import numpy as np
from numba import prange
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pmcl_ros.evidence.contour_map import ContourMap, harmonics
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.modes import SAME_PROPOSAL
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.orientation import Orientation
from pmcl_ros.pmcl.proposals.templates import DIRECTIONS, POINTS, Templates
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.back_end import Renderer
from pmcl_ros.runtime.kernels import LOCK, compiled

_CELL = 4  # image px: the step of places
_BLUR = 2.0  # image px: smoothing of the edge energy, so that a contour a cell off still counts
# Weight of the energy outside a contour relative to that on it: about that of the profile.
_OUTSIDE = 0.5
# Side of a square of cells in which only the best place of each template is kept: else the
# strongest edges of the surroundings take all of them.
_SQUARE = 8
_TRIED = 12  # candidates for each pose that is kept: duplicates are suppressed
_LOG_ODDS = -1.0, 2.0  # half the log odds that a point of a template counts at least and most
_UNIT = 255  # of evidence in 16-bit integers: 64 points of 2 at most fit
_DEPTH_STEP = 0.03  # relative: a change of size of 2 px over a vessel of 150 px
_TURNS = 72  # of it in the image: 5 degrees apart
_TURNS_OF_SIDES = 36  # in the image: 10 degrees apart
_ASIDE = 0.17  # rad: by which no orientation is farther from that of a template


@dataclass(frozen=True)
class _Places:
    """Places at one depth [m] where templates fit best, in no order.

    scores: (n,). pixels: (n, 2) where the origin is seen. templates: (n,) turned ones.
    """

    depth: float
    scores: NDArray[np.float64]
    pixels: NDArray[np.float64]
    templates: NDArray[np.int64]


class Proposals:
    """Proposes poses of one object in a region of interest.

    Holds templates for the region's middle depth; `propose` is pure CPU work.
    """

    def __init__(self, renderer: Renderer, model: ObjectModel, region: Region) -> None:
        self._model = model
        self._region = region
        self._symmetry = model.symmetry
        turns = _TURNS_OF_SIDES if model.axis is None else _TURNS
        self._turns = 2 * np.pi * np.arange(turns) / turns
        self.templates = Templates.from_views(renderer, model, region.center[2])

    def within(self, region: Region) -> 'Proposals':
        """The same templates for another region."""
        other = copy(self)
        other._region = region
        return other

    def propose(self, edges: EvidenceVolume, count: int, orientation: Orientation | None = None
                ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The best `count` poses (n, 4, 4) and their scores (n,), without duplicates, best first.

        orientation: of the object, if it is not any, in the frame of the camera.
        Raises LocalizationError when the object is out of view wherever in the region it is.
        """
        pinhole = edges.pinhole
        offsets, directions = self.templates.turned(self._turns, pinhole)
        flat = bool((edges.tensor == edges.tensor[:, :, :1]).all())  # one picture: at any depth
        maps = _maps_at(edges, self._region.center[2]) if flat else None
        places = [self._at_depth(edges, depth, _maps_at(edges, depth) if maps is None else maps,
                                 offsets, directions, _TRIED * count, orientation)
                  for depth in self._region.depths(_DEPTH_STEP)]
        seen = [each for each in places if each is not None]
        if not seen:
            raise self._region.out_of_view(pinhole)
        scores = np.concatenate([each.scores for each in seen])
        best = np.argsort(-scores, kind='stable')[:_TRIED * count]
        pixels = np.concatenate([each.pixels for each in seen])[best]
        depths = np.concatenate([np.full(len(each.scores), each.depth) for each in seen])[best]
        template = np.concatenate([each.templates for each in seen])[best]
        side, turn = np.divmod(template, len(self._turns))
        poses = _poses(pinhole, pixels, depths, self.templates.rotations[side], self._turns[turn])
        poses[:, :3, 3] = self._region.clip(poses[:, :3, 3])  # places are whole cells
        if orientation is not None:
            poses[:, :3, :3] = orientation.clip(poses[:, :3, :3])
        kept = _suppress_duplicates(poses, count, self._symmetry)
        return poses[kept], scores[best[kept]]

    def _at_depth(self, edges: EvidenceVolume, depth: float, maps: NDArray[np.int16],
                  offsets: NDArray[np.float32], directions: NDArray[np.uint8], count: int,
                  orientation: Orientation | None) -> _Places | None:
        """The best `count` places at a depth; None where the object is out of view in all.

        maps: (directions, rows, columns) of cells.
        """
        pinhole = edges.pinhole
        scale = self.templates.depth / depth
        cells = np.rint(offsets * np.float32(scale / _CELL)).astype(np.int32)
        reach = int(np.abs(cells).max()) + 1
        _, height, width = maps.shape
        left, top, right, bottom = self._region.footprint(pinhole, depth)
        # Farther out than the object's reach nothing of it is seen.
        columns = np.arange(max(int(np.floor(left / _CELL)), -reach),
                            min(int(np.ceil(right / _CELL)), width + reach) + 1)
        rows = np.arange(max(int(np.floor(top / _CELL)), -reach),
                         min(int(np.ceil(bottom / _CELL)), height + reach) + 1)
        if not len(columns) or not len(rows):
            return None
        # Around the image there is no evidence either way.
        before = max(0, reach - rows[0]), max(0, reach - columns[0])
        after = (max(0, reach + rows[-1] + 1 - height), max(0, reach + columns[-1] + 1 - width))
        maps = np.pad(maps, ((0, 0), *zip(before, after, strict=True)))
        where = rows[0] + before[0], columns[0] + before[1], len(rows), len(columns)
        possible = self._possible(pinhole, rows, columns, orientation)
        tried = np.flatnonzero(possible.any(axis=1))
        with LOCK:
            sums, place = _slide(maps, cells[tried], directions[tried], *where, _SQUARE)
        focal = np.sqrt(pinhole.fx * pinhole.fy)
        lengths = np.repeat(self.templates.lengths, len(self._turns))[tried] * focal * scale
        scores = (sums * (lengths[:, None] / _UNIT / POINTS))
        scores = np.where(possible[tried], scores, -np.inf).ravel()
        best = np.argpartition(-scores, min(count, len(scores)) - 1)[:count]
        best = best[np.isfinite(scores[best])]
        place = place.ravel()[best]
        row, column = np.divmod(place, len(columns))
        pixels = _middle(np.stack([columns[column], rows[row]], axis=-1))
        return _Places(depth, scores[best], pixels, tried[best // sums.shape[1]])

    def _possible(self, pinhole: Pinhole, rows: NDArray[np.int64], columns: NDArray[np.int64],
                  orientation: Orientation | None) -> NDArray[np.bool_]:
        """(templates, squares) where turned templates show the object as it can be.

        rows, columns: of cells, of which squares are made as `_slide` does.
        """
        top, left = np.meshgrid(rows[::_SQUARE], columns[::_SQUARE], indexing='ij')
        number = len(self.templates.rotations) * len(self._turns)
        if orientation is None:
            return np.broadcast_to(True, (number, top.size))
        sight = _towards(pinhole, _middle(np.stack([left.ravel(), top.ravel()], axis=-1)
                                          + _SQUARE // 2))
        turned = (Rotation.from_rotvec(self._turns[:, None] * [0, 0, 1.0]).as_matrix()
                  @ self.templates.rotations[:, None]).reshape(-1, 3, 3)
        return orientation.allows_seen(turned, sight.inv().apply(orientation.direction), _ASIDE)


def _cells_at(edges: EvidenceVolume, depth: float) -> tuple[NDArray[np.float32], int, int]:
    """The tensor at a depth, of whole cells; rows and columns of cells."""
    count = len(edges.depths)
    label = np.clip(edges.labels(depth), 0, count - 1)
    below = min(int(label), count - 2)
    part = np.float32(label - below)
    tensor = (1 - part) * edges.tensor[:, :, below] + part * edges.tensor[:, :, below + 1]
    height, width = (max(1, side // _CELL) for side in tensor.shape[:2])
    return tensor[:height * _CELL, :width * _CELL], height, width


def _maps_at(edges: EvidenceVolume, depth: float) -> NDArray[np.int16]:
    """(directions, rows, columns) of cells: what templates are correlated with."""
    return (_log_odds_maps(edges, depth) if isinstance(edges, ContourMap)
            else _evidence_maps(edges, depth))


def _evidence_maps(edges: EvidenceVolume, depth: float) -> NDArray[np.int16]:
    """(directions, rows, columns) of cells, in units of 1 / 255.

    Edge energy on a contour of each normal there, less half of that outside it.
    """
    whole, height, width = _cells_at(edges, depth)
    cells = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    # A cell's mean is a part of the blur.
    tensor = cv2.GaussianBlur(cells, (0, 0), (_BLUR ** 2 - (_CELL ** 2 - 1) / 12) ** 0.5 / _CELL)
    maps = np.zeros((DIRECTIONS, height, width), np.int16)
    for k, angle in enumerate(2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS):
        nx, ny = np.cos(angle), np.sin(angle)
        across = tensor @ np.array([nx * nx, ny * ny, 2 * nx * ny], np.float32)
        energy = np.sqrt(np.maximum(across, 0))
        outside = np.zeros_like(energy)
        for distance in (3.0, 4.5, 6.0):
            step = distance * _BLUR / _CELL
            move = np.array([[1, 0, -step * nx], [0, 1, -step * ny]])
            outside += cv2.warpAffine(energy, move, (width, height),
                                      borderMode=cv2.BORDER_REPLICATE) / 3
        maps[k] = np.rint(_UNIT * (np.minimum(energy, 2) - _OUTSIDE * np.minimum(outside, 2)))
    return maps


def _log_odds_maps(odds: ContourMap, depth: float) -> NDArray[np.int16]:
    """As `_evidence_maps`: log odds of a contour of each normal somewhere in a cell, halved."""
    tensor, height, width = _cells_at(odds, depth)
    maps = np.zeros((DIRECTIONS, height, width), np.int16)
    for k, each in enumerate(harmonics(2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)):
        ratio = cv2.resize(np.exp(tensor @ each), (width, height), interpolation=cv2.INTER_AREA)
        ratio = cv2.GaussianBlur(ratio, (0, 0), _BLUR / _CELL)
        maps[k] = np.rint(_UNIT * np.clip(np.log(ratio) / 2, *_LOG_ODDS))
    return maps


@compiled(parallel=True)
def _slide(maps, offsets, directions,  # type: ignore[no-untyped-def]
           row, column, rows, columns, side):
    """Each template's best sum over each square of places, and which place (row-major) that is.

    Whole rows of the maps are added, one after the other, with what lies between the places: long
    loops without branches.
    """
    count, points = directions.shape
    width = maps.shape[2]
    lines = maps.reshape(len(maps), -1)
    length = (rows - 1) * width + columns
    across = -(-columns // side)
    squares = across * -(-rows // side)
    best = np.zeros((count, squares), np.int16)
    place = np.zeros((count, squares), np.int32)
    for n in prange(count):
        starts = (row + offsets[n, :, 1]) * width + column + offsets[n, :, 0]
        total = np.zeros(length, np.int16)
        for p in range(0, points, 4):
            a = lines[directions[n, p], starts[p]:starts[p] + length]
            b = lines[directions[n, p + 1], starts[p + 1]:starts[p + 1] + length]
            c = lines[directions[n, p + 2], starts[p + 2]:starts[p + 2] + length]
            d = lines[directions[n, p + 3], starts[p + 3]:starts[p + 3] + length]
            for i in range(length):
                total[i] += a[i] + b[i] + c[i] + d[i]
        for k in range(squares):
            top, left = k // across * side, k % across * side
            best[n, k] = total[top * width + left]
            place[n, k] = top * columns + left
            for r in range(top, min(top + side, rows)):
                for c in range(left, min(left + side, columns)):
                    if total[r * width + c] > best[n, k]:
                        best[n, k] = total[r * width + c]
                        place[n, k] = r * columns + c
    return best, place


def _poses(pinhole: Pinhole, pixels: NDArray[np.float64], depths: NDArray[np.float64],
           rotations: NDArray[np.float64], turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4, 4) with the origin at `pixels` (n, 2) and `depths` (n,) [m].

    They are seen along that line of sight as the template of `rotations` (n, 3, 3), turned by
    `turns` (n,) [rad], is from ahead.
    """
    rays, towards = _rays(pinhole, pixels), _towards(pinhole, pixels)
    turned = Rotation.from_rotvec(turns[:, None] * [0, 0, 1.0]) * Rotation.from_matrix(rotations)
    poses = np.tile(np.eye(4), (len(pixels), 1, 1))
    poses[:, :3, :3] = (towards * turned).as_matrix()
    poses[:, :3, 3] = rays * depths[:, None]
    return poses


def _rays(pinhole: Pinhole, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) to pixels (n, 2), at depth 1."""
    return np.stack([(pixels[:, 0] - pinhole.cx) / pinhole.fx,
                     (pixels[:, 1] - pinhole.cy) / pinhole.fy, np.ones(len(pixels))], axis=-1)


def _towards(pinhole: Pinhole, pixels: NDArray[np.float64]) -> Rotation:
    """The smallest rotations from straight ahead to the lines of sight of pixels (n, 2)."""
    tangent = np.cross([0, 0, 1.0], _rays(pinhole, pixels))
    sine = np.linalg.norm(tangent, axis=1, keepdims=True)
    return Rotation.from_rotvec(tangent / np.maximum(sine, 1e-12) * np.arctan(sine))


def _middle(cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, 2) pixel in the middle of each of cells (n, 2)."""
    return np.asarray(cells * _CELL + (_CELL - 1) / 2)


def _suppress_duplicates(poses: NDArray[np.float64], count: int, symmetry: Symmetry) -> list[int]:
    """Non-maximum suppression: indices of poses to keep, best first, `count` at most."""
    free = np.ones(len(poses), bool)
    kept: list[int] = []
    # The origin of equivalent poses is at most so far off.
    reach = SAME_PROPOSAL[0] + 1.01 * np.linalg.norm(symmetry.discrete[:, :3, 3], axis=1).max()
    tree = cKDTree(poses[:, :3, 3])
    while len(kept) < count and free.any():
        best = int(free.argmax())
        kept.append(best)
        near = np.array(tree.query_ball_point(poses[best, :3, 3], reach))
        near = near[free[near]]
        free[near] = ~symmetry.same_mode(poses[near], poses[best], *SAME_PROPOSAL)
        free[best] = False
    return kept
