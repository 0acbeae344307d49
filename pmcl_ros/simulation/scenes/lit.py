"""Rays in rooms whose lamps cast shadows: rough glass, glossy tables and labels too."""

import numpy as np

from pmcl_ros.runtime.kernels import compiled
from pmcl_ros.simulation.scenes.lamps import irradiated
from pmcl_ros.simulation.scenes.materials import fresnel, reflected, refracted
from pmcl_ros.simulation.scenes.sampling import scattered, tilted, uniform
from pmcl_ros.simulation.scenes.trace import (
    BRANCHES,
    SURFACES,
    absorbed,
    add,
    nearest,
    place,
    put,
    room,
    texel,
    trace,
)

_DIRECT, _REFLECTED, _CHOSEN = 0, 1, 2  # how a ray came to wait
_FAINT = 3e-3  # a path of less weight ends
_ALIVE = 0.12  # weight from which every reflection is followed; fainter ones at random
_LIMIT = 1.0  # of what is chosen by chance, in units of a white surface's radiance
_HARDLY = 0.08  # a path of less weight looks for no shadows


@compiled(inlined=True, inner=True, exact=True)
def follow(  # type: ignore[no-untyped-def]
        world, waiting, hit, other, stack, state, seen, light, ox, oy, oz, dx, dy, dz):
    """As `trace.trace`, with shadows where there are lamps.

    other: (9,) scratch. seen: of `lamps.irradiated`. Inlined: to hand on the world once more took
    a third of the time of a simple scene.
    """
    if len(world.lamps) == 0:
        trace(world, waiting, hit, stack, state, light, ox, oy, oz, dx, dy, dz)
    else:
        _follow_lit(world, waiting, hit, other, stack, state, seen, light, ox, oy, oz, dx, dy, dz)


@compiled(inner=True, exact=True)
def _follow_lit(  # type: ignore[no-untyped-def]
        world, waiting, hit, other, stack, state, seen, light, ox, oy, oz, dx, dy, dz):
    """As `follow`, in a room with lamps.

    The reflections of what is seen directly are all followed; other faint ones by chance. What
    those find is limited, as single pixels would shine otherwise.
    """
    count = 1
    limit = _LIMIT * 0.282095 * (world.ambient[0, 0] + world.ambient[0, 1] + world.ambient[0, 2])
    put(waiting[0], ox, oy, oz, dx, dy, dz, 1.0, 1.0, 1.0)
    waiting[0, 9] = _DIRECT
    while count > 0:
        count -= 1
        ray = waiting[count]
        ox, oy, oz, dx, dy, dz = ray[0], ray[1], ray[2], ray[3], ray[4], ray[5]
        red, green, blue = ray[6], ray[7], ray[8]
        direct, chosen = ray[9] == _DIRECT, ray[9] == _CHOSEN
        for step in range(SURFACES):
            if max(red, green, blue) < _FAINT:
                break
            kind, t, number, outside, inside = nearest(world, hit, stack, ox, oy, oz, dx, dy, dz)
            if kind == 0:
                r, g, b = room(world, dx, dy, dz)
                most = limit if chosen else 1e9
                add(light, min(red * r, most), min(green * g, most), min(blue * b, most), 1.0)
                break
            ox, oy, oz = ox + t * dx, oy + t * dy, oz + t * dz
            nx, ny, nz = hit[0], hit[1], hit[2]
            gx, gy, gz = nx, ny, nz
            matt, texture, u, v = 0.0, -1, 0.0, 0.0  # share of light from a texture
            clear, before, behind, rough, index = False, 0, 0, 0.0, 1.0
            if kind == 2:
                s = world.sheets[number]
                texture, u, v, matt = int(s[14]), hit[6] * s[15], hit[7] * s[15], s[16]
                clear, index, rough = s[16] < 1, s[17], s[18]
            else:
                leaves = hit[3] * dx + hit[4] * dy + hit[5] * dz > 0
                before, behind = (inside, outside) if leaves else (outside, inside)
                way = -1.0 if leaves else 1.0
                nx, ny, nz = way * nx, way * ny, way * nz
                gx, gy, gz = way * hit[3], way * hit[4], way * hit[5]
                medium, body = world.materials[before], world.materials[behind]
                red, green, blue = absorbed(medium, t, red, green, blue)
                clear, rough = body[0] == 1, max(body[7], medium[7])
                # what has no coat reflects nothing, under water neither
                index = body[1] / medium[1] if clear or body[1] > 1 else 1.0
                if clear and index == 1:
                    continue
                matt, texture, u, v = _matt_part(world, number, hit, body, outside, nx, ny, nz)
            if -(nx * dx + ny * dy + nz * dz) <= 1e-6:  # the smooth normal looks away
                nx, ny, nz = gx, gy, gz
            share, within = 0.0, 1.0
            mx, my, mz = nx, ny, nz
            if index != 1:
                if rough > 0:
                    mx, my, mz = tilted(state, rough, nx, ny, nz, dx, dy, dz)
                    chosen = True
                cosine = min(-(mx * dx + my * dy + mz * dz), 1.0)
                share, within = fresnel(cosine, 1.0, index)
            rx, ry, rz = reflected(dx, dy, dz, mx, my, mz)
            if gx * rx + gy * ry + gz * rz <= 0:  # a rough surface would reflect into itself
                rx, ry, rz = reflected(dx, dy, dz, gx, gy, gz)
            if matt > 0:
                r, g, b = irradiated(world, other, stack, state, seen, step == 0 and count == 0,
                                    (kind == 2 and clear) or max(red, green, blue) < _HARDLY,
                                    ox, oy, oz, nx, ny, nz, gx, gy, gz)
                tr, tg, tb = texel(world.textures[texture], u, v)
                part = matt if clear else matt * (1 - share)
                add(light, red * r * tr, green * g * tg, blue * b * tb, part)
                if not clear:
                    weight = share * max(red, green, blue)
                    kept = 1.0 if direct else min(1.0, weight / _ALIVE)
                    if weight <= 0 or (kept < 1 and uniform(state) >= kept):
                        break
                    direct, chosen = False, chosen or kept < 1
                    up = share / kept
                    red, green, blue = red * up, green * up, blue * up
                    dx, dy, dz = rx, ry, rz
                    continue
                if matt >= 1:
                    break
                red, green, blue = red * (1 - matt), green * (1 - matt), blue * (1 - matt)
            if kind == 2:  # translucent: it scatters
                if rough > 0:
                    dx, dy, dz = scattered(state, rough, dx, dy, dz)
                continue
            if share >= 1:
                dx, dy, dz = rx, ry, rz
                continue
            weight = share * max(red, green, blue)
            kept = 1.0 if direct else min(1.0, weight / _ALIVE)
            if weight > 0 and count < BRANCHES and (kept >= 1 or uniform(state) < kept):
                up = share / kept
                put(waiting[count], ox, oy, oz, rx, ry, rz, red * up, green * up, blue * up)
                waiting[count, 9] = _CHOSEN if chosen or kept < 1 else _REFLECTED
                count += 1
            red, green, blue = red * (1 - share), green * (1 - share), blue * (1 - share)
            cosine = min(-(mx * dx + my * dy + mz * dz), 1.0)
            dx, dy, dz = refracted(dx, dy, dz, mx, my, mz, 1 / index, cosine, within)


@compiled(inner=True, exact=True)
def _matt_part(world, number, hit, body, outside, nx, ny, nz):  # type: ignore[no-untyped-def]
    """(share of the light that comes from a texture, texture, u, v) at a point of a solid.

    hit: of `nearest`. body: the medium behind the surface. n: the normal against the ray.
    """
    if body[0] == 1:  # clear: it may have a decal outside
        return _decal(world, number, hit) if outside == 0 else (0.0, -1, 0.0, 0.0)
    u, v = place(world, number, hit, nx, ny, nz)
    return 1.0, int(body[5]), u * body[6], v * body[6]


@compiled(inner=True, exact=True)
def _decal(world, number, hit):  # type: ignore[no-untyped-def]
    """(share of the light that comes from a decal, texture, u, v) at a point of a solid.

    hit: of `nearest`. Only surfaces that look away from the z axis have one.
    """
    d, p = world.decals[number], world.poses[number]
    x, y, z = hit[6], hit[7], hit[8]
    if d[6] <= 0 or not d[0] <= z <= d[1]:
        return 0.0, -1, 0.0, 0.0
    nx = p[0, 0] * hit[3] + p[0, 1] * hit[4] + p[0, 2] * hit[5]
    ny = p[1, 0] * hit[3] + p[1, 1] * hit[4] + p[1, 2] * hit[5]
    azimuth = np.arctan2(y, x)
    aside = abs((azimuth - d[2] + np.pi) % (2 * np.pi) - np.pi)
    if aside > d[3] or nx * x + ny * y <= 0:
        return 0.0, -1, 0.0, 0.0
    texture, u, v = int(d[4]), azimuth * np.hypot(x, y) * d[5], -z * d[5]
    share = d[6]
    if d[7] > 0:
        r, g, b = texel(world.textures[texture], u, v)
        share *= min(max(4 * ((r + g + b) / 3 - d[7]) / d[7], 0.0), 1.0)
    return share, texture, u, v
