"""Proposals: an exhaustive search over orientation, depth and place on coarse contours.

Uniform particles rarely fall into the basin of the pose (1e-5 of the region). Relative to its own
line of sight an object has the same outline anywhere in the image, up to scale. So a template of
each orientation is rendered once, scaled to each depth, and correlated with maps of the contour
evidence.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, fields

import cv2
import numpy as np
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
from pmcl_ros.pmcl.proposals.branch_and_bound import (
    MARGIN,
    SQUARE,
    best_places,
    blocks_of,
    strips_of,
    upper_bounds,
)
from pmcl_ros.pmcl.proposals.templates import DIRECTIONS, POINTS, Templates
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.render.back_end import Renderer

_CELL = 4  # image px: the step of places
_BLUR = 2.0  # image px: smoothing of the edge energy, so that a contour a cell off still counts
# Weight of the energy outside a contour relative to that on it: about that of the profile.
_OUTSIDE = 0.5
_TRIED = 12  # candidates for each pose that is kept: duplicates are suppressed
_LOG_ODDS = -1.0, 2.0  # half the log odds that a point of a template counts at least and most
_UNIT = 255  # of evidence in 16-bit integers: 64 points of 2 at most fit
_DEPTH_STEP = 0.03  # relative: a change of size of 2 px over a vessel of 150 px
_TURNS = 72  # of it in the image: 5 degrees apart
_TURNS_OF_SIDES = 36  # in the image: 10 degrees apart
AT_ONCE = 8192  # pairs of a template and a square that are tried before bounds are looked at again
_ASIDE = 0.17  # rad: by which no orientation is farther from that of a template


# Of pairs (n,) of a template and a square: their scores, and the best place in each.
_Exact = Callable[[NDArray[np.int64]], tuple[NDArray[np.float64], NDArray[np.int32]]]


@dataclass(frozen=True)
class _Places:
    """Places where templates fit best, in no order.

    scores: (n,). pixels: (n, 2) where the origin is seen. depths: (n,) [m]. templates: (n,) turned
    ones.
    """

    scores: NDArray[np.float64]
    pixels: NDArray[np.float64]
    depths: NDArray[np.float64]
    templates: NDArray[np.int64]

    @classmethod
    def none(cls) -> '_Places':
        return cls(np.zeros(0), np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64))

    def best(self, count: int) -> '_Places':
        """The best `count`, best first."""
        order = np.argsort(-self.scores, kind='stable')[:count]
        return _Places(self.scores[order], self.pixels[order], self.depths[order],
                       self.templates[order])

    def __add__(self, other: '_Places') -> '_Places':
        return _Places(*(np.concatenate([getattr(self, each.name), getattr(other, each.name)])
                         for each in fields(self)))


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
        turned = self.templates.turned(self._turns, pinhole)
        flat = bool((edges.tensor == edges.tensor[:, :, :1]).all())  # the same at any depth
        maps = _maps_at(edges, self._region.center[2]) if flat else None
        best, seen = _Places.none(), False
        for depth in self._region.depths(_DEPTH_STEP):
            here = _maps_at(edges, depth) if maps is None else maps
            there = self._at_depth(pinhole, depth, here, *turned, orientation, best.scores,
                                   _TRIED * count)
            if there is not None:
                best, seen = (best + there).best(_TRIED * count), True
        if not seen:
            raise self._region.out_of_view(pinhole)
        side, turn = np.divmod(best.templates, len(self._turns))
        poses = _poses(pinhole, best.pixels, best.depths, self.templates.rotations[side],
                       self._turns[turn])
        poses[:, :3, 3] = self._region.clip(poses[:, :3, 3])  # places are whole cells
        if orientation is not None:
            poses[:, :3, :3] = orientation.clip(poses[:, :3, :3])
        kept = _suppress_duplicates(poses, count, self._symmetry)
        return poses[kept], best.scores[kept]

    def _at_depth(self, pinhole: Pinhole, depth: float, maps: NDArray[np.int16],
                  offsets: NDArray[np.float32], directions: NDArray[np.uint8],
                  orientation: Orientation | None, known: NDArray[np.float64], count: int
                  ) -> _Places | None:
        """Those places at a depth that are among the best `count`; None where none is in view.

        maps: (directions, rows, columns) of cells. known: scores of the best elsewhere.
        """
        scale = self.templates.depth / depth
        cells = np.rint(offsets * np.float32(scale / _CELL)).astype(np.int32)
        reach = int(np.abs(cells).max()) + 1
        rows, columns = self._places(pinhole, depth, reach, maps.shape[1:])
        if not len(columns) or not len(rows):
            return None
        possible = self._possible(pinhole, rows, columns, orientation)
        tried = np.flatnonzero(possible.any(axis=1))
        possible, cells, directions = possible[tried], cells[tried], directions[tried]
        focal = np.sqrt(pinhole.fx * pinhole.fy)
        weights = (np.repeat(self.templates.lengths, len(self._turns))[tried]
                   * (focal * scale / _UNIT / POINTS))
        maps, *first = _padded(maps, rows, columns, reach)
        where = *first, len(rows), len(columns)
        strips = strips_of(maps)

        def exact(pairs: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
            template, square = np.divmod(pairs, possible.shape[1])
            sums, place = np.zeros(len(pairs), np.int16), np.zeros(len(pairs), np.int32)
            best_places(strips, cells, directions, *where, template, square, sums, place)
            return sums * weights[template], place

        bounds = np.zeros(possible.shape, np.int16)
        upper_bounds(blocks_of(maps), cells, directions, *where, bounds)
        highest = np.where(possible, bounds * weights[:, None], -np.inf)
        pairs, scores, place = _best(highest.ravel(), exact, known, count)
        row, column = np.divmod(place, len(columns))
        pixels = _middle(np.stack([columns[column], rows[row]], axis=-1))
        return _Places(scores, pixels, np.full(len(scores), depth),
                       tried[pairs // possible.shape[1]])

    def _places(self, pinhole: Pinhole, depth: float, reach: int, shape: tuple[int, ...]
                ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of cells where the origin may be seen at a depth; none: out of view.

        reach: of the object [cells]. shape: rows and columns of the image.
        """
        left, top, right, bottom = self._region.footprint(pinhole, depth)
        # Farther out than the object's reach nothing of it is seen.
        height, width = shape
        rows = np.arange(max(int(np.floor(top / _CELL)), -reach),
                         min(int(np.ceil(bottom / _CELL)), height + reach) + 1)
        columns = np.arange(max(int(np.floor(left / _CELL)), -reach),
                            min(int(np.ceil(right / _CELL)), width + reach) + 1)
        return rows, columns

    def _possible(self, pinhole: Pinhole, rows: NDArray[np.int64], columns: NDArray[np.int64],
                  orientation: Orientation | None) -> NDArray[np.bool_]:
        """(templates, squares) where turned templates show the object as it can be.

        rows, columns: of cells, of which squares are made as `upper_bounds` does.
        """
        top, left = np.meshgrid(rows[::SQUARE], columns[::SQUARE], indexing='ij')
        number = len(self.templates.rotations) * len(self._turns)
        if orientation is None:
            return np.broadcast_to(True, (number, top.size))
        sight = _towards(pinhole, _middle(np.stack([left.ravel(), top.ravel()], axis=-1)
                                          + SQUARE // 2))
        turned = (Rotation.from_rotvec(self._turns[:, None] * [0, 0, 1.0]).as_matrix()
                  @ self.templates.rotations[:, None]).reshape(-1, 3, 3)
        return orientation.allows_seen(turned, sight.inv().apply(orientation.direction), _ASIDE)


def _padded(maps: NDArray[np.int16], rows: NDArray[np.int64], columns: NDArray[np.int64],
            reach: int) -> tuple[NDArray[np.int16], int, int]:
    """Maps that templates lie in wherever their origin is; the first row and column there."""
    _, height, width = maps.shape
    beyond = reach + 1 + MARGIN
    before = max(0, reach - int(rows[0])), max(0, reach - int(columns[0]))
    after = max(0, int(rows[-1]) + beyond - height), max(0, int(columns[-1]) + beyond - width)
    # Around the image there is no evidence either way.
    maps = np.pad(maps, ((0, 0), *zip(before, after, strict=True)))
    return maps, int(rows[0]) + before[0], int(columns[0]) + before[1]


def _best(bounds: NDArray[np.float64], exact: _Exact, known: NDArray[np.float64], count: int
          ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int32]]:
    """Which have one of the best `count` scores, those scores, and what else `exact` tells.

    bounds: (n,) no score is greater; -inf: never one of the best. known: scores of others.
    """
    found = []
    known = np.sort(known)[-count:]
    while len(left := np.flatnonzero(bounds > (known[0] if len(known) == count else -np.inf))):
        first = left
        if len(left) > AT_ONCE:
            first = left[np.argpartition(-bounds[left], AT_ONCE)[:AT_ONCE]]
        scores, places = exact(first)
        found.append((first, scores, places))
        known = np.sort(np.concatenate([known, scores]))[-count:]
        bounds[first] = -np.inf
    if not found:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int32)
    pairs, scores, places = (np.concatenate(part) for part in zip(*found, strict=True))
    best = np.flatnonzero(scores >= known[0])
    best = best[np.argsort(pairs[best])]
    return pairs[best], scores[best], places[best]


def _cells_at(edges: EvidenceVolume, depth: float) -> tuple[NDArray[np.float32], int, int]:
    """The tensor at a depth, of whole cells; rows and columns of cells."""
    last = edges.tensor.shape[2] - 1
    label = np.clip(edges.labels(depth), 0, last)
    below = int(label)
    part = np.float32(label - below)
    tensor = edges.tensor[:, :, below]
    if part:
        tensor = (1 - part) * tensor + part * edges.tensor[:, :, below + 1]
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
