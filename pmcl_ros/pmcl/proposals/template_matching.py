"""EvidenceVolume -> proposals: a search of all orientations, depths and places, coarsely.

Uniform particles rarely fall into the basin of the pose (1e-5 of the region). Relative to its own
line of sight an object has the same outline anywhere in the image, up to scale. So a template of
each orientation is rendered once, scaled to each depth, and correlated with maps of the contour
evidence.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.pmcl.modes import SAME_PROPOSAL, suppress_duplicates
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.orientation import Orientation
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.proposals.branch_and_bound import SQUARE, best_places, upper_bounds
from pmcl_ros.pmcl.proposals.evidence_maps import (
    CELL,
    UNIT,
    Origins,
    PaddedMaps,
    maps_at,
    whole_cells,
)
from pmcl_ros.pmcl.proposals.templates import POINTS, Templates
from pmcl_ros.pmcl.render.back_end import Renderer

_TRIED = 12  # candidates for each pose that is kept: duplicates are suppressed
_PAIRS = 2 ** 24  # of templates and squares whose bounds are kept at once
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

    def propose(self, volume: EvidenceVolume, count: int, orientation: Orientation | None = None
                ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The best `count` poses (n, 4, 4) and their scores (n,), without duplicates, best first.

        orientation: of the object, if it is not any, in the frame of the camera.
        Raises LocalizationError when the object is out of view wherever in the region it is.
        """
        pinhole = volume.pinhole
        offsets, directions = self.templates.turned(self._turns, pinhole)
        farthest = np.abs(offsets).max()
        origins = [each for depth in self._region.depths(_DEPTH_STEP)
                   if (each := self._origins(pinhole, depth, farthest, volume.tensor.shape))]
        if not origins:
            raise self._region.out_of_view(pinhole)
        flat = bool((volume.tensor == volume.tensor[:, :, :1]).all())  # the same at any depth
        shared = PaddedMaps.around(maps_at(volume, origins[0].depth), origins) if flat else None
        best = _Places.none()
        for each in origins:
            maps = shared or PaddedMaps.around(maps_at(volume, each.depth), [each])
            best = (best + self._at_depth(pinhole, each, maps, offsets, directions, orientation,
                                          best.scores, _TRIED * count)).best(_TRIED * count)
        side, turn = np.divmod(best.templates, len(self._turns))
        poses = _poses(pinhole, best.pixels, best.depths, self.templates.rotations[side],
                       self._turns[turn])
        poses[:, :3, 3] = self._region.clip(poses[:, :3, 3])  # places are whole cells
        if orientation is not None:
            poses[:, :3, :3] = orientation.clip(poses[:, :3, :3])
        kept = suppress_duplicates(poses, self._symmetry, count, SAME_PROPOSAL)
        return poses[kept], best.scores[kept]

    def _at_depth(self, pinhole: Pinhole, origins: Origins, maps: PaddedMaps,
                  offsets: NDArray[np.float32], directions: NDArray[np.uint8],
                  orientation: Orientation | None, known: NDArray[np.float64], count: int
                  ) -> _Places:
        """Those places at a depth that are among the best `count`.

        known: scores of the best elsewhere.
        """
        cells = np.rint(offsets * np.float32(origins.scale / CELL)).astype(np.int32)
        rows, columns = origins.rows, origins.columns
        templates, possible = self._possible(pinhole, rows, columns, orientation)
        cells, directions = cells[templates], directions[templates]
        focal = np.sqrt(pinhole.fx * pinhole.fy)
        weights = (np.repeat(self.templates.lengths, len(self._turns))[templates]
                   * (focal * origins.scale / UNIT / POINTS))
        size, first = (len(rows), len(columns)), (int(rows[0]), int(columns[0]))

        def exact(pairs: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
            template, square = np.divmod(pairs, possible.shape[1])
            sums, place = np.zeros(len(pairs), np.int16), np.zeros(len(pairs), np.int32)
            best_places(maps.strips, cells, directions, *first, *size, template, square, sums,
                        place)
            return sums * weights[template], place

        blocks, *first_of_them = maps.blocks_about(origins)
        squares = possible.shape[1]
        at_once = max(_PAIRS // squares, 1)  # templates whose bounds are in memory together
        found = []
        for begin in range(0, len(cells), at_once):
            part = slice(begin, begin + at_once)
            bounds = np.zeros(possible[part].shape, np.int16)
            upper_bounds(blocks, cells[part], directions[part], *first_of_them, *size, bounds)
            highest = bounds * weights[part, None]
            if orientation is not None:
                highest[~possible[part]] = -np.inf
            found.append(_best(highest.ravel(), exact, begin * squares, known, count))
            known = np.concatenate([known, found[-1][1]])
        pairs, scores, place = (np.concatenate(each) for each in zip(*found, strict=True))
        row, column = np.divmod(place, len(columns))
        pixels = _middle(np.stack([columns[column], rows[row]], axis=-1))
        template = pairs // possible.shape[1]
        return _Places(scores, pixels, np.full(len(scores), origins.depth),
                       np.arange(len(offsets))[templates][template])

    def _origins(self, pinhole: Pinhole, depth: float, farthest: float, shape: tuple[int, ...]
                 ) -> Origins | None:
        """Where the origin may be seen at a depth; None: out of view.

        farthest: of the templates' offsets [px]. shape: rows and columns of the image.
        """
        left, top, right, bottom = self._region.footprint(pinhole, depth)
        scale = self.templates.depth / depth
        reach = int(np.rint(farthest * np.float32(scale / CELL))) + 1
        # Farther out than the object's reach nothing of it is seen.
        height, width = whole_cells(shape)
        rows = np.arange(max(int(np.floor(top / CELL)), -reach),
                         min(int(np.ceil(bottom / CELL)), height + reach) + 1)
        columns = np.arange(max(int(np.floor(left / CELL)), -reach),
                            min(int(np.ceil(right / CELL)), width + reach) + 1)
        return Origins(depth, scale, reach, rows, columns) if len(rows) and len(columns) else None

    def _possible(self, pinhole: Pinhole, rows: NDArray[np.int64], columns: NDArray[np.int64],
                  orientation: Orientation | None
                  ) -> tuple[slice | NDArray[np.int64], NDArray[np.bool_]]:
        """Turned templates that show the object as it can be, (templates, squares) and where.

        rows, columns: of cells, of which squares are made as `upper_bounds` does.
        """
        top, left = np.meshgrid(rows[::SQUARE], columns[::SQUARE], indexing='ij')
        number = len(self.templates.rotations) * len(self._turns)
        if orientation is None:
            return slice(None), np.broadcast_to(True, (number, top.size))
        sight = _towards(pinhole, _middle(np.stack([left.ravel(), top.ravel()], axis=-1)
                                          + SQUARE // 2))
        turned = (Rotation.from_rotvec(self._turns[:, None] * [0, 0, 1.0]).as_matrix()
                  @ self.templates.rotations[:, None]).reshape(-1, 3, 3)
        directions = sight.inv().apply(orientation.direction)
        parts = np.array_split(turned, -(-number * top.size * len(orientation.axes) // _PAIRS))
        possible = np.concatenate([orientation.allows_seen(each, directions, _ASIDE)
                                   for each in parts])
        templates = np.flatnonzero(possible.any(axis=1))
        return templates, possible[templates]


def _best(bounds: NDArray[np.float64], exact: _Exact, begin: int, known: NDArray[np.float64],
          count: int) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int32]]:
    """Which have one of the best `count` scores, those scores, and what else `exact` tells.

    bounds: (n,) no score is greater; -inf: never one of the best. begin: number of the first of
    them. known: scores of others.
    """
    found = []
    known = np.sort(np.concatenate([np.full(count, -np.inf), known]))[-count:]
    left = np.flatnonzero(bounds > known[0])
    while len(left):
        first, left = _highest(left, bounds)
        scores, places = exact(begin + first)
        found.append((begin + first, scores, places))
        known = np.sort(np.concatenate([known, scores]))[-count:]
        left = left[bounds[left] > known[0]]
    if not found:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int32)
    pairs, scores, places = (np.concatenate(part) for part in zip(*found, strict=True))
    best = np.flatnonzero(scores >= known[0])
    best = best[np.argsort(pairs[best])]
    return pairs[best], scores[best], places[best]


def _highest(left: NDArray[np.int64], bounds: NDArray[np.float64]
             ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The `AT_ONCE` of those left that have the highest bounds, and the others."""
    if len(left) <= AT_ONCE:
        return left, left[:0]
    order = np.argpartition(-bounds[left], AT_ONCE)
    return left[order[:AT_ONCE]], left[order[AT_ONCE:]]


def _poses(pinhole: Pinhole, pixels: NDArray[np.float64], depths: NDArray[np.float64],
           rotations: NDArray[np.float64], turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4, 4) with the origin at `pixels` (n, 2) and `depths` (n,) [m].

    They are seen along that line of sight as the template of `rotations` (n, 3, 3), turned by
    `turns` (n,) [rad], is from ahead.
    """
    turned = Rotation.from_rotvec(turns[:, None] * [0, 0, 1.0]) * Rotation.from_matrix(rotations)
    return pose_of(_towards(pinhole, pixels) * turned, pinhole.rays(pixels) * depths[:, None])


def _towards(pinhole: Pinhole, pixels: NDArray[np.float64]) -> Rotation:
    """The smallest rotations from straight ahead to the lines of sight of pixels (n, 2)."""
    tangent = np.cross([0, 0, 1.0], pinhole.rays(pixels))
    sine = np.linalg.norm(tangent, axis=1, keepdims=True)
    return Rotation.from_rotvec(tangent / np.maximum(sine, 1e-12) * np.arctan(sine))


def _middle(cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, 2) pixel in the middle of each of cells (n, 2)."""
    return np.asarray(cells * CELL + (CELL - 1) / 2)
