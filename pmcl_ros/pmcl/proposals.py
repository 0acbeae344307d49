"""Where to look first: every orientation, depth and place in the region of interest, scored on a coarse contour.

Uniform particles practically never fall into the narrow basin of the pose (1e-5 of the region). But seen along its own
line of sight an object keeps its outline wherever in the image it is, up to size: so a template of each orientation is
rendered once, scaled to each depth, and slid over maps of the contour evidence by plain additions.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import prange
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import EdgeVolume
from pmcl_ros.kernels import LOCK, compiled
from pmcl_ros.lightfield.geometry import Pinhole
from pmcl_ros.pmcl.gl import GlContext
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.summary import same_mode
from pmcl_ros.pmcl.zbuffers import Window, ZBuffers

_CELL = 4  # image px: the step of places
_BLUR = 3.0  # image px: the smoothing of the edge energy, so that a contour a cell off still counts
_DIRECTIONS = 32  # of contour normals
_POINTS = 64  # of a template
_DEPTH_STEP = 0.03  # relative: a change of size of 2 px over a vessel of 150 px
_TILTS = 25  # of a symmetry axis against the line of sight: 7.5 degrees apart
_SIDES = 400  # from which an object without symmetry is seen: about 10 degrees apart
_TURNS = 72  # in the image: 5 degrees apart
_ALIKE_DISTANCE, _ALIKE_ANGLE = 0.012, 0.2  # m, rad: closer proposals are one
_TEMPLATE = 256  # px: side of a template's z-buffer


@dataclass(frozen=True)
class _Templates:
    """rotations: (n, 3, 3), object to a camera that looks straight at it. offsets: (n, points, 2) of the outline from
    the projected origin in units of tan(angle). normals: (n, points) angle of the outward normal [rad].
    lengths: (n,) of the outline, same units."""

    rotations: NDArray[np.float64]
    offsets: NDArray[np.float64]
    normals: NDArray[np.float64]
    lengths: NDArray[np.float64]


class Proposals:
    """Proposes poses of one object in a region of interest.

    Holds templates for the region's middle depth; `propose` is pure CPU work.
    """

    def __init__(self, context: GlContext, model: ObjectModel, region: Region) -> None:
        self._region = region
        self._axis = model.axis
        views = _viewing_rotations(model)
        self._templates = _templates(context, model, region.center[2], views)

    def propose(self, edges: EdgeVolume, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The best `count` poses (n, 4, 4) and their coarse scores (n,), no two alike, best first."""
        depths = self._region.depths(_DEPTH_STEP)
        poses, scores = zip(*(self._at_depth(edges, depth) for depth in depths), strict=True)
        return _distinct(np.concatenate(poses), np.concatenate(scores), count, self._axis)

    def _at_depth(self, edges: EdgeVolume, depth: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        pinhole = edges.pinhole
        left, top, right, bottom = self._region.footprint(pinhole, depth)
        columns = np.arange(int(np.floor(left / _CELL)), int(np.ceil(right / _CELL)) + 1)
        rows = np.arange(int(np.floor(top / _CELL)), int(np.ceil(bottom / _CELL)) + 1)
        t = self._templates
        turn = 2 * np.pi * np.arange(_TURNS) / _TURNS
        cos, sin = np.cos(turn)[None, :, None], np.sin(turn)[None, :, None]
        x, y = t.offsets[:, None, :, 0], t.offsets[:, None, :, 1]
        scale = self._region.center[2] / depth / _CELL
        offsets = np.rint(np.stack([(cos * x - sin * y) * pinhole.fx, (sin * x + cos * y) * pinhole.fy], -1)
                          * scale).astype(np.int64)
        angle = t.normals[:, None, :] + turn[None, :, None]
        directions = np.rint(angle / (2 * np.pi) * _DIRECTIONS).astype(np.int64) % _DIRECTIONS
        reach = int(np.abs(offsets).max()) + 1
        maps = _evidence_maps(edges, depth)
        # Around the image there is no evidence either way.
        pad_left, pad_top = max(0, reach - columns[0]), max(0, reach - rows[0])
        pad_right = max(0, reach + columns[-1] + 1 - maps.shape[2])
        pad_bottom = max(0, reach + rows[-1] + 1 - maps.shape[1])
        maps = np.pad(maps, ((0, 0), (pad_top, pad_bottom), (pad_left, pad_right)))
        with LOCK:
            best, place = _slide(maps, offsets.reshape(-1, _POINTS, 2), directions.reshape(-1, _POINTS),
                                 rows[0] + pad_top, columns[0] + pad_left, len(rows), len(columns))
        lengths = np.repeat(t.lengths, _TURNS) * pinhole.fx * self._region.center[2] / depth
        row, column = rows[place // len(columns)], columns[place % len(columns)]
        pixels = np.stack([column, row], axis=-1) * _CELL + (_CELL - 1) / 2
        poses = _poses(pinhole, pixels, depth, np.repeat(t.rotations, _TURNS, axis=0), np.tile(turn, len(t.lengths)))
        poses[:, :3, 3] = self._region.clip(poses[:, :3, 3])  # places are whole cells
        return poses, best * lengths / _POINTS


def _viewing_rotations(model: ObjectModel) -> NDArray[np.float64]:
    """(n, 3, 3) rotations that show the object from every side, up to a turn in the image."""
    if model.axis is not None:
        upright = Rotation.align_vectors([[0, 0, 1.0]], model.axis[None])[0]
        tilts = np.linspace(0, np.pi, _TILTS)
        return (Rotation.from_rotvec(tilts[:, None] * [0, 1.0, 0]) * upright).as_matrix()
    # A Fibonacci lattice on the sphere of lines of sight.
    k = np.arange(_SIDES) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / _SIDES), np.pi * (1 + 5 ** 0.5) * k
    return (Rotation.from_rotvec(polar[:, None] * [0, 1.0, 0])
            * Rotation.from_rotvec(azimuth[:, None] * [0, 0, 1.0])).as_matrix()


def _templates(context: GlContext, model: ObjectModel, depth: float, rotations: NDArray[np.float64]) -> _Templates:
    """Outlines of the object, its origin straight ahead at `depth`."""
    depth = max(depth, 1.5 * model.radius)
    half = _TEMPLATE / 2
    focal = 0.95 * half * (depth ** 2 - model.radius ** 2) ** 0.5 / model.radius
    camera = Pinhole(_TEMPLATE, _TEMPLATE, focal, focal, half - 0.5, half - 0.5)
    zbuffers = ZBuffers(context, model.vertices, model.faces, camera, Window(0, 0, (_TEMPLATE, _TEMPLATE)),
                        depth - 1.01 * model.radius, depth + 1.01 * model.radius, closed=model.closed, capacity=64)
    poses = np.tile(np.eye(4), (len(rotations), 1, 1))
    poses[:, :3, :3], poses[:, 2, 3] = rotations, depth
    outlines = []
    for first in range(0, len(poses), zbuffers.capacity):
        batch = poses[first:first + zbuffers.capacity]
        zbuffers.draw(batch)
        outlines += [_outline(mask) for mask in zbuffers.read(len(batch)) > 0]
    zbuffers.release()
    points, normals, lengths = (np.stack(part) for part in zip(*outlines, strict=True))
    return _Templates(rotations, (points - camera.cx) / focal, normals, lengths / focal)


def _outline(mask: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64], np.float64]:
    """Points (n, 2) at equal steps along a mask's border, the angles of its outward normals, its length [px]."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    # Edge pixels of the mask lie half a pixel inside its border; smoothing gives the staircase a direction.
    smooth = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2.0)
    gx, gy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    pixels = np.concatenate([each[:, 0] for each in contours])
    length = np.float64(sum(cv2.arcLength(each, True) for each in contours))
    pixels = pixels[np.linspace(0, len(pixels), _POINTS, endpoint=False).astype(int)]
    angles = np.arctan2(-gy[pixels[:, 1], pixels[:, 0]], -gx[pixels[:, 1], pixels[:, 0]])
    return pixels + 0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=-1), angles.astype(np.float64), length


def _evidence_maps(edges: EdgeVolume, depth: float) -> NDArray[np.float32]:
    """(directions, rows, columns): edge energy on a contour of each normal there, less that outside it, per cell."""
    inverse = 1 / edges.depths
    label = np.clip((1 / depth - inverse[0]) / (inverse[1] - inverse[0]), 0, len(inverse) - 1)
    below = min(int(label), len(inverse) - 2)
    part = np.float32(label - below)
    tensor = (1 - part) * edges.tensor[:, :, below] + part * edges.tensor[:, :, below + 1]
    height, width = (side // _CELL for side in tensor.shape[:2])
    tensor = cv2.resize(cv2.GaussianBlur(tensor, (0, 0), _BLUR)[:height * _CELL, :width * _CELL], (width, height),
                        interpolation=cv2.INTER_AREA)
    maps = np.zeros((_DIRECTIONS, height, width), np.float32)
    for k, angle in enumerate(2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS):
        nx, ny = np.cos(angle), np.sin(angle)
        energy = np.sqrt(np.maximum(tensor @ np.array([nx * nx, ny * ny, 2 * nx * ny], np.float32), 0))
        outside = np.zeros_like(energy)
        for distance in (3.0, 4.5, 6.0):
            step = distance * _BLUR / _CELL
            move = np.array([[1, 0, -step * nx], [0, 1, -step * ny]])
            outside += cv2.warpAffine(energy, move, (width, height), borderMode=cv2.BORDER_REPLICATE) / 3
        maps[k] = np.minimum(energy, 2) - np.minimum(outside, 2)
    return maps


@compiled(parallel=True)
def _slide(maps, offsets, directions, row, column, rows, columns):  # type: ignore[no-untyped-def]
    """Each template's best sum over all places, and which place (row-major) that is."""
    count, points = directions.shape
    best = np.zeros(count, np.float32)
    place = np.zeros(count, np.int64)
    for n in prange(count):
        total = np.zeros((rows, columns), np.float32)
        for p in range(points):
            plane = maps[directions[n, p]]
            y, x = row + offsets[n, p, 1], column + offsets[n, p, 0]
            for r in range(rows):
                line = plane[y + r]
                for c in range(columns):
                    total[r, c] += line[x + c]
        at = np.argmax(total)
        best[n] = total.ravel()[at]
        place[n] = at
    return best, place


def _poses(pinhole: Pinhole, pixels: NDArray[np.float64], depth: float, rotations: NDArray[np.float64],
           turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses with the origin at `pixels` and `depth`, seen along that line of sight as the template is from ahead."""
    rays = np.stack([(pixels[:, 0] - pinhole.cx) / pinhole.fx, (pixels[:, 1] - pinhole.cy) / pinhole.fy,
                     np.ones(len(pixels))], axis=-1)
    tangent = np.cross([0, 0, 1.0], rays)  # the smallest rotation from straight ahead to the ray
    sine = np.linalg.norm(tangent, axis=1, keepdims=True)
    towards = Rotation.from_rotvec(tangent / np.maximum(sine, 1e-12) * np.arctan(sine))
    poses = np.tile(np.eye(4), (len(pixels), 1, 1))
    poses[:, :3, :3] = (towards * Rotation.from_rotvec(turns[:, None] * [0, 0, 1.0]) * Rotation.from_matrix(rotations)
                        ).as_matrix()
    poses[:, :3, 3] = rays * depth
    return poses


def _distinct(poses: NDArray[np.float64], scores: NDArray[np.float64], count: int,
              axis: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The best poses of which no two show the object alike."""
    order = np.argsort(-scores, kind='stable')[:40 * count]
    poses, scores = poses[order], scores[order]
    free = np.ones(len(poses), bool)
    kept: list[int] = []
    while len(kept) < count and free.any():
        best = int(free.argmax())
        kept.append(best)
        free &= ~same_mode(poses, poses[best], axis, _ALIKE_DISTANCE, _ALIKE_ANGLE)
    return poses[kept], scores[kept]
