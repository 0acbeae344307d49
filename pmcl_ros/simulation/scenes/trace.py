"""The light that comes along one ray: reflected, refracted, absorbed, scattered."""

import numpy as np

from pmcl_ros.runtime.kernels import compiled
from pmcl_ros.simulation.scenes.environment import look_up, shade
from pmcl_ros.simulation.scenes.nearest import nearest
from pmcl_ros.simulation.scenes.optics import fresnel, reflected, refracted
from pmcl_ros.simulation.scenes.random_numbers import chance

BRANCHES = 24  # rays waiting at most: more reflections than that are left out
_SURFACES = 24  # on one path at most
_FAINT = 1e-3  # a path of less weight ends
_AROUND = 0.03  # m: radius at which a texture wound about a solid is undistorted
_ALIVE = 0.05  # weight from which every reflection is followed; fainter ones by lot


@compiled()
def trace(  # type: ignore[no-untyped-def]
        world, waiting, hit, stack, state, light, ox, oy, oz, dx, dy, dz):
    """Add to light (3,) the radiance that comes to o from the direction d (camera's frame).

    waiting: (BRANCHES, 10), hit: (9,), stack: (64,): scratch. state: (1,) uint64 of `chance`.
    At each surface the refracted ray is followed, the reflected one too, or in its stead by lot
    at a weight that makes the mean right.
    """
    count = 1
    _put(waiting[0], ox, oy, oz, dx, dy, dz, 1.0, 1.0, 1.0)
    while count > 0:
        count -= 1
        ray = waiting[count]
        ox, oy, oz, dx, dy, dz = ray[0], ray[1], ray[2], ray[3], ray[4], ray[5]
        red, green, blue = ray[6], ray[7], ray[8]
        for _ in range(_SURFACES):
            if max(red, green, blue) < _FAINT:
                break
            kind, t, number, outside, inside = nearest(world, hit, stack, ox, oy, oz, dx, dy, dz)
            if kind == 0:
                m = world.turn
                r, g, b = look_up(world.panorama, m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz,
                                  m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz,
                                  m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz)
                light[0] += red * r
                light[1] += green * g
                light[2] += blue * b
                break
            ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
            nx, ny, nz = hit[0], hit[1], hit[2]
            if kind == 2:
                s = world.sheets[number]
                r, g, b = _seen(world, int(s[14]), hit[6] * s[15], hit[7] * s[15], nx, ny, nz)
                share = s[16]
                light[0] += red * r * share
                light[1] += green * g * share
                light[2] += blue * b * share
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
            medium = world.matter[before]
            red *= np.exp(-medium[2] * t)
            green *= np.exp(-medium[3] * t)
            blue *= np.exp(-medium[4] * t)
            body = world.matter[behind]
            if body[0] == 1 and body[1] == medium[1]:
                continue
            share, within = fresnel(cosine, medium[1], body[1])
            rx, ry, rz = reflected(dx, dy, dz, nx, ny, nz)
            if body[0] == 0:  # opaque
                u, v = _place(world, number, hit, nx, ny, nz)
                r, g, b = _seen(world, int(body[5]), u * body[6], v * body[6], nx, ny, nz)
                light[0] += red * r * (1 - share)
                light[1] += green * g * (1 - share)
                light[2] += blue * b * (1 - share)
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
            if weight > 0 and count < BRANCHES and (kept >= 1 or chance(state) < kept):
                up = share / kept
                _put(waiting[count], ox, oy, oz, rx, ry, rz, red * up, green * up, blue * up)
                count += 1
            red, green, blue = red * (1 - share), green * (1 - share), blue * (1 - share)
            dx, dy, dz = refracted(dx, dy, dz, nx, ny, nz, medium[1] / body[1], cosine, within)


@compiled()
def _put(ray, ox, oy, oz, dx, dy, dz, red, green, blue):  # type: ignore[no-untyped-def]
    ray[0], ray[1], ray[2], ray[3], ray[4], ray[5] = ox, oy, oz, dx, dy, dz
    ray[6], ray[7], ray[8] = red, green, blue


@compiled()
def _place(world, number, hit, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Where on a solid's texture a point lies [m]: around z and along it, or flat on its ends.

    hit: of `nearest`. n: the normal, camera's frame.
    """
    turn = world.poses[number]
    up = turn[2, 0] * nx + turn[2, 1] * ny + turn[2, 2] * nz
    if abs(up) > 0.8:
        return hit[6], hit[7]
    return np.arctan2(hit[7], hit[6]) * _AROUND, -hit[8]


@compiled()
def _seen(world, number, u, v, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Radiance of a matt surface: its texture at (u, v) [sides] in the room's light."""
    texture = world.textures[number]
    size = texture.shape[0]
    u, v = (u - np.floor(u)) * size, (v - np.floor(v)) * size
    i, j = int(u), int(v)
    a, b = np.float32(u - i), np.float32(v - j)
    i, j = i % size, j % size
    k, m = (i + 1) % size, (j + 1) % size
    one = np.float32(1)
    w0, w1, w2, w3 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    r, g, bl = shade(world.irradiance, nx, ny, nz)
    return (r * (w0 * texture[j, i, 0] + w1 * texture[j, k, 0] + w2 * texture[m, i, 0]
                 + w3 * texture[m, k, 0]),
            g * (w0 * texture[j, i, 1] + w1 * texture[j, k, 1] + w2 * texture[m, i, 1]
                 + w3 * texture[m, k, 1]),
            bl * (w0 * texture[j, i, 2] + w1 * texture[j, k, 2] + w2 * texture[m, i, 2]
                  + w3 * texture[m, k, 2]))
