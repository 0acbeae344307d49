"""Labels the occluding contours of a scene's solids, with their directions, and their inside."""

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.kernels import compiled
from pmcl_ros.simulation.scenes.render import first_surfaces
from pmcl_ros.simulation.scenes.world import World

DIRECTIONS = 32  # of normals: 11.25 degrees apart
_FINE = 3  # rays per pixel along an axis
_GAP = 0.008  # m: what is so much farther than its neighbour is behind it
_TOUCHES = 0.005  # m: a sheet that is nearer by more is before a solid, not beside or behind it
_EVEN = 0.003  # m: neighbouring pixels that differ by less have no contour between them
_REACH = 4  # fine pixels: the contour on both sides of a point that tells its direction

Values = TypeVar('Values', NDArray[np.bool_], NDArray[np.float32])


@dataclass(frozen=True)
class ContourLabels:
    """What a contour map is to say of a picture.

    direction: (height, width) int8: -1 where no occluding contour passes within half a pixel of
        the pixel's centre, else k: its normal, from the nearer surface to what is behind, has the
        angle 2 pi k / DIRECTIONS = atan2(down, right) in the image.
    inside: (height, width) bool: the first surface is a solid's.
    """

    direction: NDArray[np.int8]
    inside: NDArray[np.bool_]


def contour_labels(world: World, pinhole: Pinhole) -> ContourLabels:
    """The labels of a scene at each pixel of a camera in its centre view.

    A contour parts a solid from what is at least 8 mm behind it, or from a sheet or nothing (so
    the line in which a solid touches the table belongs to it). Opaque sheets hide what is behind
    them; translucent ones do not. A contour's place is good to about 0.2 px, its direction to 6
    degrees.
    """
    solid, depth = _first(world, pinhole, None)
    uneven = np.zeros(solid.shape, bool)
    for along in (0, 1):
        one, two = [slice(None)] * 2, [slice(None)] * 2
        one[along], two[along] = slice(None, -1), slice(1, None)
        here, there = tuple(one), tuple(two)
        with np.errstate(invalid='ignore'):
            step = ~(np.abs(depth[here] - depth[there]) < _EVEN) & (solid[here] | solid[there])
        uneven[here] |= step
        uneven[there] |= step
    near = _enlarged(cv2.dilate(uneven.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
    fine = pinhole.resized(_FINE * pinhole.width, _FINE * pinhole.height)
    finer_solid, finer_depth = _first(world, fine, near)
    solid = np.where(near, finer_solid, _enlarged(solid))
    depth = np.where(near, finer_depth, _enlarged(depth))
    direction = np.full((pinhole.height, pinhole.width), -1, np.int8)
    _label(_steps(solid, depth), np.ascontiguousarray(_steps(solid.T, depth.T).T), direction)
    middle = _FINE // 2
    return ContourLabels(direction, solid[middle::_FINE, middle::_FINE].copy())


def _enlarged(values: Values) -> Values:
    """Each pixel (height, width) as fine pixels."""
    return values.repeat(_FINE, axis=0).repeat(_FINE, axis=1)


def _first(world: World, pinhole: Pinhole, where: NDArray[np.bool_] | None
           ) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Whether a solid is first at each pixel (height, width), and the depth, infinite for nothing.
    """
    owners, depth = first_surfaces(world, pinhole, np.zeros(len(world.kinds), np.int64),
                                   with_sheets=True, where=where)
    return owners >= 0, np.where(depth > 0, depth, np.float32(np.inf))


def _steps(solid: NDArray[np.bool_], depth: NDArray[np.floating]) -> NDArray[np.int8]:
    """(height, width) where a contour runs between a pixel and the next one of its row.

    1: the pixel is the nearer side, -1: the next one is, 0: there is no contour.
    """
    one, two = depth[:, :-1], depth[:, 1:]
    steps = np.zeros(depth.shape, np.int8)
    for sign, near, far, of, beside in ((1, one, two, solid[:, :-1], solid[:, 1:]),
                                        (-1, two, one, solid[:, 1:], solid[:, :-1])):
        gap = np.where(beside, _GAP, -_TOUCHES)
        steps[:, :-1][of & (far > near + gap)] = sign
    return steps


@compiled(exact=True)
def _label(right, down, direction):  # type: ignore[no-untyped-def]
    """Fill `direction` from the steps along rows (right) and columns (down) of fine pixels.

    The steps next to a point are unit normals of pieces of the contour. Their sum is the normal of
    the contour there, and their mean place is on it: errors of the pixel grid cancel. Steps that
    point the opposite way belong to the other side of something thin.
    """
    height, width = right.shape
    for i in range(direction.shape[0]):
        for j in range(direction.shape[1]):
            y, x = _FINE * i + _FINE // 2, _FINE * j + _FINE // 2
            least, axis, sign, at_x, at_y = 1.2 * _FINE, 0, 0, 0.0, 0.0
            for b in range(max(y - _FINE, 0), min(y + _FINE + 1, height)):
                for a in range(max(x - _FINE, 0), min(x + _FINE + 1, width)):
                    if right[b, a] != 0:
                        away = np.hypot(a + 0.5 - x, b - y)
                        if away < least:
                            least, axis, sign, at_x, at_y = away, 0, right[b, a], a + 0.5, b + 0.0
                    if down[b, a] != 0:
                        away = np.hypot(a - x, b + 0.5 - y)
                        if away < least:
                            least, axis, sign, at_x, at_y = away, 1, down[b, a], a + 0.0, b + 0.5
            if sign == 0:
                continue
            nx, ny, total, sum_x, sum_y = 0.0, 0.0, 0.0, 0.0, 0.0
            for b in range(max(int(at_y) - _REACH, 0), min(int(at_y) + _REACH + 2, height)):
                for a in range(max(int(at_x) - _REACH, 0), min(int(at_x) + _REACH + 2, width)):
                    for each in range(2):
                        step = right[b, a] if each == 0 else down[b, a]
                        if step == 0 or (each == axis and step != sign):
                            continue
                        dx = a + (0.5 if each == 0 else 0.0) - at_x
                        dy = b + (0.5 if each == 1 else 0.0) - at_y
                        weight = np.exp(-(dx * dx + dy * dy) / 8.0)
                        total += weight
                        sum_x += weight * dx
                        sum_y += weight * dy
                        if each == 0:
                            nx += weight * step
                        else:
                            ny += weight * step
            length = np.hypot(nx, ny)
            if length < 1e-9:
                continue
            away = (nx * (at_x + sum_x / total - x) + ny * (at_y + sum_y / total - y)) / length
            if abs(away) <= 0.5 * _FINE:
                turn = np.arctan2(ny, nx) / (2 * np.pi) * DIRECTIONS
                direction[i, j] = int(np.floor(turn + 0.5)) % DIRECTIONS
