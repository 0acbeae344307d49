"""The light that comes along one ray: first surface, reflection, refraction, absorption."""

import numpy as np

from pmcl_ros.runtime.kernels import compiled
from pmcl_ros.simulation.scenes.environment import look_up, shade
from pmcl_ros.simulation.scenes.materials import fresnel, reflected, refracted
from pmcl_ros.simulation.scenes.sampling import uniform
from pmcl_ros.simulation.scenes.shapes.revolution import frustum_normal, meet_frusta
from pmcl_ros.simulation.scenes.shapes.triangles import meet_triangles

_NEAR = 1e-6  # m: a ray that starts on a surface does not meet it again
_FAR = 1e3  # m: nothing in a scene is farther
_SOLID, _SHEET = 1, 2  # kinds of what a ray meets; 0: nothing
DEPTH = 64  # of a hierarchy of boxes, at most
BRANCHES = 24  # rays waiting at most: more reflections than that are left out
SURFACES = 24  # on one path at most
_FAINT = 1e-3  # a path of less weight ends
AROUND = 0.03  # m: radius at which a texture wound about a solid is undistorted
_ALIVE = 0.05  # weight from which every reflection is followed; fainter ones at random


@compiled(inner=True, exact=True)
def nearest_solid(world, hit, stack, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """The first solid on the ray from o along d (length 1), in the camera's frame.

    Returns (kind, t, number, media outside, inside): kind 1 a solid, 0 nothing. hit: (9,) gets the
    smooth and the flat unit normal, out of the solid, and the point in the solid's frame.
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


@compiled(exact=True)
def nearest(world, hit, stack, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """The first solid (kind 1) or sheet (kind 2) on a ray; else as `nearest_solid`.

    hit: of a sheet its normal against the ray, and the point (x, y) in its frame.
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


@compiled(inner=True, exact=True)
def _face_normal(c):  # type: ignore[no-untyped-def]
    ax, ay, az = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    bx, by, bz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / length, ny / length, nz / length


@compiled(exact=True)
def trace(  # type: ignore[no-untyped-def]
        world, waiting, hit, stack, state, light, ox, oy, oz, dx, dy, dz):
    """Add to light (3,) the radiance that comes to o from the direction d (camera's frame).

    waiting: (BRANCHES, 10), hit: (9,), stack: (DEPTH,): scratch. state: (1,) uint64 of `uniform`.
    At each surface the refracted ray is followed. The reflected one is followed too; a faint one
    only at random (Russian roulette), with a weight that keeps the mean unbiased.
    """
    count = 1
    put(waiting[0], ox, oy, oz, dx, dy, dz, 1.0, 1.0, 1.0)
    while count > 0:
        count -= 1
        ray = waiting[count]
        ox, oy, oz, dx, dy, dz = ray[0], ray[1], ray[2], ray[3], ray[4], ray[5]
        red, green, blue = ray[6], ray[7], ray[8]
        for _ in range(SURFACES):
            if max(red, green, blue) < _FAINT:
                break
            kind, t, number, outside, inside = nearest(world, hit, stack, ox, oy, oz, dx, dy, dz)
            if kind == 0:
                r, g, b = room(world, dx, dy, dz)
                add(light, red * r, green * g, blue * b, 1.0)
                break
            ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
            nx, ny, nz = hit[0], hit[1], hit[2]
            if kind == 2:
                s = world.sheets[number]
                r, g, b = _seen(world, int(s[14]), hit[6] * s[15], hit[7] * s[15], nx, ny, nz)
                share = s[16]
                add(light, red * r, green * g, blue * b, share)
                if share >= 1:
                    break
                red, green, blue = red * (1 - share), green * (1 - share), blue * (1 - share)
                continue
            leaves = hit[3] * dx + hit[4] * dy + hit[5] * dz > 0
            before, behind = (inside, outside) if leaves else (outside, inside)
            if leaves:
                nx, ny, nz = -nx, -ny, -nz
            cosine = -(nx * dx + ny * dy + nz * dz)
            if cosine <= 1e-6:  # the smooth normal looks away where the flat one does not
                way = -1.0 if leaves else 1.0
                nx, ny, nz = way * hit[3], way * hit[4], way * hit[5]
                cosine = -(nx * dx + ny * dy + nz * dz)
            cosine = min(cosine, 1.0)
            medium = world.materials[before]
            red, green, blue = absorbed(medium, t, red, green, blue)
            body = world.materials[behind]
            if body[0] == 1 and body[1] == medium[1]:
                continue
            share, within = fresnel(cosine, medium[1], body[1])
            if body[0] == 0 and body[1] <= 1:  # it has no coat
                share = 0.0
            rx, ry, rz = reflected(dx, dy, dz, nx, ny, nz)
            if body[0] == 0:  # opaque
                u, v = place(world, number, hit, nx, ny, nz)
                r, g, b = _seen(world, int(body[5]), u * body[6], v * body[6], nx, ny, nz)
                add(light, red * r, green * g, blue * b, 1 - share)
                if share <= 0:
                    break
                red, green, blue = red * share, green * share, blue * share
                dx, dy, dz = rx, ry, rz
                continue
            if share >= 1:
                dx, dy, dz = rx, ry, rz
                continue
            weight = share * max(red, green, blue)
            kept = min(1.0, weight / _ALIVE)
            if weight > 0 and count < BRANCHES and (kept >= 1 or uniform(state) < kept):
                up = share / kept
                put(waiting[count], ox, oy, oz, rx, ry, rz, red * up, green * up, blue * up)
                count += 1
            red, green, blue = red * (1 - share), green * (1 - share), blue * (1 - share)
            dx, dy, dz = refracted(dx, dy, dz, nx, ny, nz, medium[1] / body[1], cosine, within)


@compiled(inner=True, exact=True)
def add(light, red, green, blue, share):  # type: ignore[no-untyped-def]
    """Add a share of what comes along a path to light (3,)."""
    light[0] += red * share
    light[1] += green * share
    light[2] += blue * share


@compiled(inner=True, exact=True)
def absorbed(medium, length, red, green, blue):  # type: ignore[no-untyped-def]
    """What is left of weights after a way [m] through a medium (Beer and Lambert)."""
    return (red * np.exp(-medium[2] * length), green * np.exp(-medium[3] * length),
            blue * np.exp(-medium[4] * length))


@compiled(inner=True, exact=True)
def put(ray, ox, oy, oz, dx, dy, dz, red, green, blue):  # type: ignore[no-untyped-def]
    """Let a ray wait: origin, direction, weights."""
    ray[0], ray[1], ray[2], ray[3], ray[4], ray[5] = ox, oy, oz, dx, dy, dz
    ray[6], ray[7], ray[8] = red, green, blue


@compiled(inner=True, exact=True)
def place(world, number, hit, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Texture coordinates of a point of a solid [m]: around z and along it, flat on its ends.

    hit: of `nearest`. n: the normal, camera's frame.
    """
    turn = world.poses[number]
    up = turn[2, 0] * nx + turn[2, 1] * ny + turn[2, 2] * nz
    if abs(up) > 0.8:
        return hit[6], hit[7]
    return np.arctan2(hit[7], hit[6]) * AROUND, -hit[8]


@compiled(inner=True, exact=True)
def room(world, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Radiance (red, green, blue) of the room in the direction d (camera's frame)."""
    m = world.turn
    return look_up(world.panorama, m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz,
                   m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz,
                   m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz)


@compiled(inner=True, exact=True)
def texel(texture, u, v):  # type: ignore[no-untyped-def]
    """Reflectance (red, green, blue) at (u, v) [sides]."""
    size = texture.shape[0]
    u, v = (u - np.floor(u)) * size, (v - np.floor(v)) * size
    i, j = int(u), int(v)
    a, b = np.float32(u - i), np.float32(v - j)
    i, j = i % size, j % size
    k, m = (i + 1) % size, (j + 1) % size
    one = np.float32(1)
    w0, w1, w2, w3 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    return (w0 * texture[j, i, 0] + w1 * texture[j, k, 0] + w2 * texture[m, i, 0]
            + w3 * texture[m, k, 0],
            w0 * texture[j, i, 1] + w1 * texture[j, k, 1] + w2 * texture[m, i, 1]
            + w3 * texture[m, k, 1],
            w0 * texture[j, i, 2] + w1 * texture[j, k, 2] + w2 * texture[m, i, 2]
            + w3 * texture[m, k, 2])


@compiled(inner=True, exact=True)
def _seen(world, number, u, v, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Radiance of a matt surface: its texture at (u, v) [sides] in the room's light."""
    r, g, b = shade(world.irradiance, nx, ny, nz)
    red, green, blue = texel(world.textures[number], u, v)
    return r * red, g * green, b * blue
