"""Where what is in a liquid with flat faces seems to be: the kernel."""

import math

from pmcl_ros.geometry.interface import EDGE
from pmcl_ros.runtime.kernels import compiled

_THIN = 1e-9  # m: a point on a plane counts as so far beyond it
_SNELL = 5  # steps of Newton's method for where a ray meets the water


@compiled(inner=True)
def apparent(x, y, z, water):  # type: ignore[no-untyped-def]
    """Where a point [m] seems to be, as of `Interface.apparent`.

    water: (k, 5) of each face its normal, the camera's height above it [m], the index.
    """
    x, y, z, count = float(x), float(y), float(z), len(water)
    for face in range(count):
        if _along(x, y, z, water, face) >= 0:
            return x, y, z
    found, shift, last = -1, 0.0, math.inf
    for _ in range(count):
        # The face that comes next by how squarely the straight line to the point meets it.
        face, deep = -1, 0.0
        for each in range(count):
            through = float(water[each, 3]) - _along(x, y, z, water, each)
            if water[each, 3] > 0 and deep < through < last:
                face, deep = each, through
        if face < 0:
            break
        last, height, index = deep, float(water[face, 3]), float(water[face, 4])
        across = math.sqrt(max(x * x + y * y + z * z - deep * deep, 0.0))
        meets, up = _bent(across, max(deep - height, _THIN), height, index)
        # The ray meets the face a part of the way from the camera's foot to the point's.
        part = meets / max(across, 1e-12)
        move = part * deep - height
        nx, ny, nz = float(water[face, 0]), float(water[face, 1]), float(water[face, 2])
        enters = True
        for other in range(count):
            enters &= other == face or _along(part * x + move * nx, part * y + move * ny,
                                              part * z + move * nz, water, other) <= EDGE
        if enters or found < 0:
            found, shift = face, up
        if enters:
            break
    if found < 0:
        return x, y, z
    return (x + shift * water[found, 0], y + shift * water[found, 1],
            z + shift * water[found, 2])


@compiled(inner=True)
def _along(x, y, z, water, face):  # type: ignore[no-untyped-def]
    """How far a point is on the air's side of a face [m]."""
    return (float(water[face, 0]) * x + float(water[face, 1]) * y + float(water[face, 2]) * z
            + float(water[face, 3]))


@compiled(inner=True)
def _bent(across, depth, height, index):  # type: ignore[no-untyped-def]
    """How far along a face a ray meets it, and how far towards it the point seems to be [m].

    across: of the point from the foot of the camera. depth: of the point, height: of the camera.
    """
    if across < 1e-6 * height:
        return 0.0, depth - depth / index
    # Newton's steps converge from the larger of two lower bounds, of steep and of grazing rays.
    least = max(across * height / (height + depth / index),
                across - depth / math.sqrt(index * index - 1))
    meets = least
    for _ in range(_SNELL):
        rest = across - meets
        above, under = math.sqrt(meets * meets + height * height), math.sqrt(
            rest * rest + depth * depth)
        off = meets / above - index * rest / under
        slope = height * height / above ** 3 + index * depth * depth / under ** 3
        meets = min(max(meets - off / slope, least), across)
    return meets, depth - height * (across - meets) / meets
