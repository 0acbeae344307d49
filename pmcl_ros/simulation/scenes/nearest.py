"""The first surface on a ray."""

import numpy as np

from pmcl_ros.runtime.kernels import compiled
from pmcl_ros.simulation.scenes.revolution import frustum_normal, meet_frusta
from pmcl_ros.simulation.scenes.triangles import meet_triangles

_NEAR = 1e-6  # m: a ray that starts on a surface does not meet it again
_FAR = 1e3
_SOLID, _SHEET = 1, 2


@compiled()
def nearest_solid(world, hit, stack, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """What solid the ray from o along d (length 1) meets first, in the camera's frame.

    Returns (kind, t, number, media outside, inside): kind 1 a solid, 0 nothing. hit: (9,) gets the
    smooth and the flat unit normal, out of the solid, and the place in the solid's frame.
    """
    best, kind, number, outside, inside = _FAR, 0, -1, 0, 0
    for k in range(len(world.kinds)):
        cx, cy, cz = world.spheres[k, 0] - ox, world.spheres[k, 1] - oy, world.spheres[k, 2] - oz
        along, radius = cx * dx + cy * dy + cz * dz, world.spheres[k, 3]
        if (cx * cx + cy * cy + cz * cz - along * along > radius * radius
                or along < -radius or along - radius > best):
            continue
        p = world.poses[k]
        lx = p[0, 0] * ox + p[0, 1] * oy + p[0, 2] * oz + p[0, 3]
        ly = p[1, 0] * ox + p[1, 1] * oy + p[1, 2] * oz + p[1, 3]
        lz = p[2, 0] * ox + p[2, 1] * oy + p[2, 2] * oz + p[2, 3]
        ex = p[0, 0] * dx + p[0, 1] * dy + p[0, 2] * dz
        ey = p[1, 0] * dx + p[1, 1] * dy + p[1, 2] * dz
        ez = p[2, 0] * dx + p[2, 1] * dy + p[2, 2] * dz
        if world.kinds[k] == 0:
            t, ring, part = meet_frusta(world.rings, world.first, world.lists, world.at[k],
                                        world.bounds[k], lx, ly, lz, ex, ey, ez, _NEAR, best)
            if ring < 0:
                continue
            x, y, z = lx + t * ex, ly + t * ey, lz + t * ez
            nx, ny, nz, gx, gy, gz = frustum_normal(world.rings[ring], part, x, y)
            outside, inside = world.media[ring, 0], world.media[ring, 1]
        else:
            t, face = meet_triangles(world.boxes, world.nodes, world.corners, world.at[k, 0],
                                     world.at[k, 1], stack, lx, ly, lz, ex, ey, ez, _NEAR, best)
            if face < 0:
                continue
            x, y, z = lx + t * ex, ly + t * ey, lz + t * ez
            nx, ny, nz = _face_normal(world.corners[face])
            gx, gy, gz = nx, ny, nz
            outside, inside = world.sides[face, 0], world.sides[face, 1]
        best, kind, number = t, _SOLID, k
        for axis in range(3):
            hit[axis] = p[0, axis] * nx + p[1, axis] * ny + p[2, axis] * nz
            hit[axis + 3] = p[0, axis] * gx + p[1, axis] * gy + p[2, axis] * gz
        hit[6], hit[7], hit[8] = x, y, z
    return kind, best, number, outside, inside


@compiled()
def nearest(world, hit, stack, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """What solid (kind 1) or sheet (kind 2) the ray meets first; else as `nearest_solid`.

    hit: of a sheet its normal against the ray, and the place (x, y) in its frame.
    """
    kind, best, number, outside, inside = nearest_solid(world, hit, stack, ox, oy, oz, dx, dy, dz)
    for k in range(len(world.sheets)):
        s = world.sheets[k]
        facing = s[9] * dx + s[10] * dy + s[11] * dz
        if abs(facing) < 1e-9:
            continue
        cx, cy, cz = s[0] - ox, s[1] - oy, s[2] - oz
        t = (s[9] * cx + s[10] * cy + s[11] * cz) / facing
        if not _NEAR < t < best:
            continue
        u = s[3] * (t * dx - cx) + s[4] * (t * dy - cy) + s[5] * (t * dz - cz)
        v = s[6] * (t * dx - cx) + s[7] * (t * dy - cy) + s[8] * (t * dz - cz)
        if abs(u) > s[12] or abs(v) > s[13]:
            continue
        best, kind, number = t, _SHEET, k
        way = -1.0 if facing > 0 else 1.0
        hit[0], hit[1], hit[2] = way * s[9], way * s[10], way * s[11]
        hit[6], hit[7] = u, v
    return kind, best, number, outside, inside


@compiled()
def _face_normal(c):  # type: ignore[no-untyped-def]
    ax, ay, az = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    bx, by, bz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / length, ny / length, nz / length
