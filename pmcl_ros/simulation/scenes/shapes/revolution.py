"""Surfaces of revolution as rings of cone frusta, and their intersection with rays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.kernels import compiled

_CREASE = np.deg2rad(35)  # a profile that turns by more has an edge there
_BINS_PER_METRE = 600  # slices of 1.7 mm


@dataclass(frozen=True)
class Frusta:
    """Rings about the z axis, each between two points (r, z), as interfaces of two media.

    rings: (n, 8) float64: r0, z0, r1, z1 [m], and the unit normals (nr, nz) at both ends. They
        point to the right of the way from 0 to 1: away from the axis where it runs up.
    media: (n, 2) int64, the medium that the normal points to, and the one behind.
    """

    rings: NDArray[np.float64]
    media: NDArray[np.int64]

    @classmethod
    def from_profile(cls, profile: NDArray[np.floating], outside: int, inside: int
                     ) -> 'Frusta':
        """From a profile (n, 2) of (r, z) [m], with the medium `outside` on its right."""
        step = np.diff(profile, axis=0)
        length = np.linalg.norm(step, axis=1)
        kept = length > 1e-9
        start, end = profile[:-1][kept], profile[1:][kept]
        flat = np.stack([step[kept, 1], -step[kept, 0]], axis=1) / length[kept, None]
        first, last = flat.copy(), flat.copy()
        smooth = (flat[:-1] * flat[1:]).sum(axis=1) > np.cos(_CREASE)
        both = flat[:-1] + flat[1:]
        both /= np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-12)
        first[1:][smooth] = both[smooth]
        last[:-1][smooth] = both[smooth]
        for ends, normals in ((start, first), (end, last)):  # level at the axis, unless a tip
            tip = (ends[:, 0] < 1e-9) & (np.abs(flat[:, 1]) > 0.8)
            normals[tip] = np.stack([0 * flat[tip, 0], np.sign(flat[tip, 1])], axis=1)
        media = np.tile(np.array([[outside, inside]], np.int64), (len(start), 1))
        return cls(np.concatenate([start, end, first, last], axis=1), media)

    def __add__(self, other: 'Frusta') -> 'Frusta':
        return Frusta(np.concatenate([self.rings, other.rings]),
                      np.concatenate([self.media, other.media]))

    def binned(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """The rings in each slice of z.

        Returns (first, rings, bounds): slice i holds rings[first[i]:first[i + 1]]; bounds: zmin,
        zmax of all slices and the largest radius [m].
        """
        low = np.minimum(self.rings[:, 1], self.rings[:, 3])
        high = np.maximum(self.rings[:, 1], self.rings[:, 3])
        bottom, top = float(low.min()) - 1e-6, float(high.max()) + 1e-6
        count = max(1, int((top - bottom) * _BINS_PER_METRE))
        size = (top - bottom) / count
        from_bin = np.clip(np.floor((low - 1e-7 - bottom) / size).astype(int), 0, count - 1)
        to_bin = np.clip(np.floor((high + 1e-7 - bottom) / size).astype(int), 0, count - 1)
        lists = [np.flatnonzero((from_bin <= each) & (each <= to_bin)) for each in range(count)]
        first = np.concatenate([[0], np.cumsum([len(each) for each in lists])]).astype(np.int64)
        radius = float(self.rings[:, [0, 2]].max()) + 1e-6
        return first, np.concatenate(lists).astype(np.int64), np.array([bottom, top, radius])


@compiled(inner=True, exact=True)
def _meet(ring, ox, oy, oz, dx, dy, dz, near, far):  # type: ignore[no-untyped-def]
    """(t, part along) of a ray's first point on a frustum in (near, far); else (far, 0)."""
    r0, z0, r1, z1 = ring[0], ring[1], ring[2], ring[3]
    dr, height = r1 - r0, z1 - z0
    if abs(height) < 1e-9:
        if abs(dz) < 1e-12:
            return far, 0.0
        t = (z0 - oz) / dz
        if t <= near or t >= far:
            return far, 0.0
        part = (np.hypot(ox + t * dx, oy + t * dy) - r0) / dr
        return (t, part) if 0 <= part <= 1 else (far, 0.0)
    k = dr / height
    base, rise = r0 + k * (oz - z0), k * dz
    a = dx * dx + dy * dy - rise * rise
    b = ox * dx + oy * dy - base * rise
    c = ox * ox + oy * oy - base * base
    if abs(a) < 1e-14:
        if abs(b) < 1e-14:
            return far, 0.0
        low = high = -0.5 * c / b
    else:
        square = b * b - a * c
        if square < 0:
            return far, 0.0
        # The form that does not subtract nearly equal numbers.
        q = -(b + np.sqrt(square)) if b > 0 else -b + np.sqrt(square)
        low = q / a
        high = c / q if q != 0 else low
        if low > high:
            low, high = high, low
    for t in (low, high):
        if near < t < far:
            part = (oz + t * dz - z0) / height
            if 0 <= part <= 1:
                return t, part
    return far, 0.0


@compiled(exact=True)
def meet_frusta(  # type: ignore[no-untyped-def]
        rings, first, lists, at, bounds, ox, oy, oz, dx, dy, dz, near, far):
    """(t, ring, part) of the first ring in (near, far) on a ray in the object's frame.

    Or (far, -1, 0). first, lists, bounds: of `Frusta.binned`; `at`: where this object's slices
    begin and end in `first`. d has length 1.
    """
    bottom, top, radius = bounds[0], bounds[1], bounds[2]
    start, end = near, far
    # The cylinder about all rings.
    a = dx * dx + dy * dy
    b, c = ox * dx + oy * dy, ox * ox + oy * oy - radius * radius
    if a < 1e-16:
        if c > 0:
            return far, -1, 0.0
    else:
        square = b * b - a * c
        if square <= 0:
            return far, -1, 0.0
        root = np.sqrt(square)
        start, end = max(start, (-b - root) / a), min(end, (-b + root) / a)
    if abs(dz) > 1e-12:
        one, two = (bottom - oz) / dz, (top - oz) / dz
        start, end = max(start, min(one, two)), min(end, max(one, two))
    elif not bottom <= oz <= top:
        return far, -1, 0.0
    if start >= end:
        return far, -1, 0.0
    count = at[1] - at[0]
    size = (top - bottom) / count
    each = min(max(int((oz + start * dz - bottom) / size), 0), count - 1)
    last = min(max(int((oz + end * dz - bottom) / size), 0), count - 1)
    way = 1 if last >= each else -1
    best, ring, part = far, -1, 0.0
    while True:
        for k in range(first[at[0] + each], first[at[0] + each + 1]):
            t, along = _meet(rings[lists[k]], ox, oy, oz, dx, dy, dz, near, best)
            if t < best:
                best, ring, part = t, lists[k], along
        if each == last:
            break
        wall = bottom + size * (each + (1 if way > 0 else 0))
        if ring >= 0 and (oz + best * dz - wall) * way <= 0:
            break
        each += way
    return best, ring, part


@compiled(exact=True)
def frustum_normal(ring, part, x, y):  # type: ignore[no-untyped-def]
    """The unit normals (smooth, then flat) at a point (x, y) of a ring, in the object's frame."""
    nr = ring[4] + part * (ring[6] - ring[4])
    nz = ring[5] + part * (ring[7] - ring[5])
    length = np.sqrt(nr * nr + nz * nz)
    gr, gz = ring[3] - ring[1], ring[0] - ring[2]
    flat = np.sqrt(gr * gr + gz * gz)
    r = np.sqrt(x * x + y * y)
    cx, cy = (x / r, y / r) if r > 1e-12 else (1.0, 0.0)
    return (nr * cx / length, nr * cy / length, nz / length,
            gr * cx / flat, gr * cy / flat, gz / flat)
