"""Closed meshes, and their intersection with rays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.kernels import compiled

_LEAF = 4  # triangles that are tested one by one


@dataclass(frozen=True)
class Triangles:
    """A mesh as the interface of two media.

    corners: (n, 3, 3) float64 [m], counter-clockwise seen from outside.
    outside, inside: the media.
    """

    corners: NDArray[np.float64]
    outside: int
    inside: int

    def tree(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """A bounding volume hierarchy.

        Returns (boxes (m, 6) low and high corner; nodes (m, 2); corners, sorted). A node is
        (-1 - first, count) of sorted triangles, or (left, right).
        """
        count = len(self.corners)
        nodes, ends, levels = _halved(count)
        middles, order = self.corners.mean(axis=1), np.arange(count)
        for firsts in levels:  # all nodes of a level at once: a mesh has thousands
            sizes = np.diff(firsts, append=count)
            there = middles[order]
            extents = (np.maximum.reduceat(there, firsts) - np.minimum.reduceat(there, firsts))
            along = np.repeat(extents.argmax(axis=1), sizes)
            places = np.where(np.repeat(sizes > _LEAF, sizes), there[np.arange(count), along], 0)
            order = order[np.lexsort((places, np.repeat(firsts, sizes)))]
        corners = self.corners[order]
        last = ((0, 1), (0, 0))  # an end may be that of all
        low = np.minimum.reduceat(np.pad(corners.min(axis=1), last), ends.ravel())[::2]
        high = np.maximum.reduceat(np.pad(corners.max(axis=1), last), ends.ravel())[::2]
        return np.concatenate([low - 1e-9, high + 1e-9], axis=1), nodes, corners


def _halved(count: int) -> tuple[NDArray[np.int64], NDArray[np.int64], list[list[int]]]:
    """A tree whose nodes halve `count` sorted triangles until they are few.

    Returns (nodes (m, 2), as of `Triangles.tree`; where each begins and ends (m, 2); where those
    of each level begin, for all levels with nodes that are halved).
    """
    nodes: list[tuple[int, int]] = []
    ends: list[tuple[int, int]] = []
    levels: list[list[int]] = []

    def build(first: int, end: int, level: int) -> int:
        here = len(nodes)
        nodes.append((-1 - first, end - first))
        ends.append((first, end))
        if level == len(levels):
            levels.append([])
        levels[level].append(first)
        if end - first > _LEAF:
            middle = first + (end - first) // 2
            left = build(first, middle, level + 1)
            nodes[here] = (left, build(middle, end, level + 1))
        return here

    build(0, count, 0)
    return np.array(nodes, np.int64), np.array(ends, np.int64), levels[:-1]


@compiled(exact=True)
def meet_triangles(  # type: ignore[no-untyped-def]
        boxes, nodes, corners, root, first, stack, ox, oy, oz, dx, dy, dz, near, far):
    """(t, triangle) of the first triangle in (near, far) on a ray; or (far, -1).

    boxes, nodes, corners: of `Triangles.tree`, those of all meshes one after the other; root and
    first: where this one's nodes and triangles begin. stack: (depth,) int64 scratch.
    """
    best, found = far, -1
    top = 0
    stack[0] = 0
    while top >= 0:
        node = stack[top]
        top -= 1
        box = boxes[root + node]
        start, end = near, best
        for axis in range(3):
            o = ox if axis == 0 else (oy if axis == 1 else oz)
            d = dx if axis == 0 else (dy if axis == 1 else dz)
            if abs(d) < 1e-300:
                if not box[axis] <= o <= box[axis + 3]:
                    end = start - 1
                continue
            one, two = (box[axis] - o) / d, (box[axis + 3] - o) / d
            start, end = max(start, min(one, two)), min(end, max(one, two))
        if start > end:
            continue
        a, b = nodes[root + node, 0], nodes[root + node, 1]
        if a >= 0:
            stack[top + 1], stack[top + 2] = a, b
            top += 2
            continue
        for k in range(first - 1 - a, first - 1 - a + b):
            t = _meet(corners[k], ox, oy, oz, dx, dy, dz)
            if near < t < best:
                best, found = t, k
    return best, found


@compiled(inner=True, exact=True)
def _meet(c, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """t at which a ray meets a triangle, or -1 (Moeller and Trumbore)."""
    ax, ay, az = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    bx, by, bz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    determinant = ax * px + ay * py + az * pz
    if abs(determinant) < 1e-18:
        return -1.0
    sx, sy, sz = ox - c[0, 0], oy - c[0, 1], oz - c[0, 2]
    u = (sx * px + sy * py + sz * pz) / determinant
    if u < 0 or u > 1:
        return -1.0
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * qx + dy * qy + dz * qz) / determinant
    if v < 0 or u + v > 1:
        return -1.0
    return (bx * qx + by * qy + bz * qz) / determinant
