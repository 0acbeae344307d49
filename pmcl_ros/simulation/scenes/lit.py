"""Rays in rooms whose lamps cast shadows: rough glass, glossy tables and labels too."""

import numpy as np
from numba import prange

from pmcl_ros.runtime.kernels import compiled
from pmcl_ros.simulation.scenes.environment import look_up, shade
from pmcl_ros.simulation.scenes.materials import fresnel, reflected, refracted
from pmcl_ros.simulation.scenes.trace import (
    BRANCHES,
    in_pupil,
    nearest,
    nearest_solid,
    place,
    put,
    uniform,
)

_DEPTH = 64  # of a hierarchy of boxes
_R1, _R2 = 0.7548776662466927, 0.5698402909980532  # powers of the plane's golden ratio
_DIRECT, _REFLECTED, _CHOSEN = 0, 1, 2  # how a ray came to wait
_SURFACES = 24  # on one path at most
_SHADES = 16  # surfaces between a point and a lamp at most
_FAINT = 3e-3  # a path of less weight ends
_ALIVE = 0.12  # weight from which every reflection is followed; fainter ones at random
_LIMIT = 1.0  # of what is chosen by chance, in units of a white surface's radiance
_RAYS = 4  # to the lamps and the room in half shadow
_CLEAR = 0.03  # there is no half shadow where this share of the light is missing, or is there
_FORGOTTEN = 0.25  # share of what a point tells about its neighbours
_HARDLY = 0.08  # a path of less weight looks for no shadows
_OFF = 1e-5  # m: where rays to the light start, above the surface
_BOUNCED = 0.3  # share of the room's light that an opaque thing sends back
_THROUGH = 0.85  # share of the room's light that comes through glass
_CORNER, _CORNER_REACH = 0.55, 0.4  # that of a sheet which is touched, and where it is 1 [m]
# Light that comes through glass at right angles and at grazing ones: what is bent away at its
# edges lands in the middle of its shadow.
_MIDDLE, _EDGE = 1.1, 0.3


@compiled(parallel=True)
def render_lit(world, numbers, samples, seed, picture):  # type: ignore[no-untyped-def]
    """Fill picture (height, width, 3) with mean radiances; numbers as `render.light_of_view`."""
    fx, fy, cx, cy, baseline, at_x, at_y, nominal_x, nominal_y, focus, pupil = numbers
    height, width = picture.shape[0], picture.shape[1]
    start = np.full(1, seed, np.uint64)
    shift_x, shift_y = uniform(start), uniform(start)
    for i in prange(height):
        state = np.full(1, seed + np.uint64(i) * np.uint64(0xD1342543DE82EF95), np.uint64)
        waiting, hit, other = np.zeros((BRANCHES, 10)), np.zeros(9), np.zeros(9)
        stack, light, seen = np.zeros(_DEPTH, np.int64), np.zeros(3), np.full(2, 0.5)
        for j in range(width):
            light[:] = 0
            for k in range(samples):
                px, py = in_pupil(state, nominal_x, nominal_y, pupil)
                ox, oy = baseline * px, baseline * py
                number = i * samples + k
                u = j + (shift_x + _R1 * number + _R2 * j) % 1 - 0.5 - cx
                v = i + (shift_y + _R2 * number + _R1 * j) % 1 - 0.5 - cy
                dx = u / fx * focus + baseline * at_x - ox
                dy = v / fy * focus + baseline * at_y - oy
                length = np.sqrt(dx * dx + dy * dy + focus * focus)
                _follow(world, waiting, hit, other, stack, state, seen, light, ox, oy, 0.0,
                        dx / length, dy / length, focus / length)
            for channel in range(3):
                picture[i, j, channel] = light[channel] / samples


@compiled(inner=True)
def _follow(  # type: ignore[no-untyped-def]
        world, waiting, hit, other, stack, state, seen, light, ox, oy, oz, dx, dy, dz):
    """As `trace.trace`, in a room with lamps. other: (9,) scratch; seen: of `_shone_on`.

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
        for step in range(_SURFACES):
            if max(red, green, blue) < _FAINT:
                break
            kind, t, number, outside, inside = nearest(world, hit, stack, ox, oy, oz, dx, dy, dz)
            if kind == 0:
                m = world.turn
                r, g, b = look_up(world.panorama, m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz,
                                  m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz,
                                  m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz)
                most = limit if chosen else 1e9
                light[0] += min(red * r, most)
                light[1] += min(green * g, most)
                light[2] += min(blue * b, most)
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
                red *= np.exp(-medium[2] * t)
                green *= np.exp(-medium[3] * t)
                blue *= np.exp(-medium[4] * t)
                clear, rough = body[0] == 1, max(body[7], medium[7])
                index = body[1] / medium[1]
                if clear and index == 1:
                    continue
                if clear and outside == 0:
                    matt, texture, u, v = _decal(world, number, hit)
                elif not clear:
                    u, v = place(world, number, hit, nx, ny, nz)
                    matt, texture, u, v = 1.0, int(body[5]), u * body[6], v * body[6]
            if -(nx * dx + ny * dy + nz * dz) <= 1e-6:  # the smooth normal looks away
                nx, ny, nz = gx, gy, gz
            share, within = 0.0, 1.0
            mx, my, mz = nx, ny, nz
            if index != 1:
                if rough > 0:
                    mx, my, mz = _tilted(state, rough, nx, ny, nz, dx, dy, dz)
                    chosen = True
                cosine = min(-(mx * dx + my * dy + mz * dz), 1.0)
                share, within = fresnel(cosine, 1.0, index)
            rx, ry, rz = reflected(dx, dy, dz, mx, my, mz)
            if gx * rx + gy * ry + gz * rz <= 0:  # a rough surface would reflect into itself
                rx, ry, rz = reflected(dx, dy, dz, gx, gy, gz)
            if matt > 0:
                r, g, b = _shone_on(world, other, stack, state, seen, step == 0 and count == 0,
                                    (kind == 2 and clear) or max(red, green, blue) < _HARDLY,
                                    ox, oy, oz, nx, ny, nz, gx, gy, gz)
                tr, tg, tb = _texel(world.textures[texture], u, v)
                part = matt if clear else matt * (1 - share)
                light[0] += red * r * tr * part
                light[1] += green * g * tg * part
                light[2] += blue * b * tb * part
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
                    dx, dy, dz = _scattered(state, rough, dx, dy, dz)
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


@compiled(inner=True)
def _shone_on(  # type: ignore[no-untyped-def]
        world, other, stack, state, seen, first, anywhere, x, y, z, nx, ny, nz, gx, gy, gz):
    """Radiance that a white surface at a point, of normal n (flat: g), sends out.

    What reaches it of the lamps' light, and of the room's, is found by one ray each. first: it is
    what the eye sees first; then by four rays where the points before it are in half shadow, as
    seen (2,) tells, which is carried on. anywhere: nothing throws a shadow there.
    """
    if anywhere:
        return shade(world.irradiance, nx, ny, nz)
    x, y, z = x + _OFF * gx, y + _OFF * gy, z + _OFF * gz
    red, green, blue, total = 0.0, 0.0, 0.0, 0.0
    for k in range(len(world.lamps)):
        lamp = world.lamps[k]
        facing = max(nx * lamp[7] + ny * lamp[8] + nz * lamp[9], 0.0)
        red += facing * lamp[4]
        green += facing * lamp[5]
        blue += facing * lamp[6]
        total += facing * (lamp[4] + lamp[5] + lamp[6])
    if total > 0:
        rays = _RAYS if first and _CLEAR < seen[0] < 1 - _CLEAR else 1
        sr, sg, sb = 0.0, 0.0, 0.0
        for k in range(rays):
            dx, dy, dz = _to_lamp(world, state, total * (k + uniform(state)) / rays, nx, ny, nz)
            if gx * dx + gy * dy + gz * dz > 0:
                r, g, b = _through(world, other, stack, x, y, z, dx, dy, dz)
                sr, sg, sb = sr + r / rays, sg + g / rays, sb + b / rays
        if first:
            seen[0] += _FORGOTTEN * (sg - seen[0])
        red, green, blue = red * sr, green * sg, blue * sb
    rays = _RAYS if first and seen[1] < 1 - _CLEAR else 1
    part = 0.0
    for k in range(rays):
        part += _open(world, other, stack, state, (k + uniform(state)) / rays, x, y, z, nx, ny, nz,
                      gx, gy, gz) / rays
    if first:
        seen[1] += _FORGOTTEN * (part - seen[1])
    r, g, b = shade(world.ambient, nx, ny, nz)
    return red + part * r, green + part * g, blue + part * b


@compiled(inner=True)
def _to_lamp(world, state, pick, nx, ny, nz):  # type: ignore[no-untyped-def]
    """The direction of a random point of the lamp whose part of the light holds `pick`."""
    k = 0
    while k < len(world.lamps) - 1:
        lamp = world.lamps[k]
        pick -= (max(nx * lamp[7] + ny * lamp[8] + nz * lamp[9], 0.0)
                 * (lamp[4] + lamp[5] + lamp[6]))
        if pick < 0:
            break
        k += 1
    lamp, m = world.lamps[k], world.turn
    cosine = lamp[0] + uniform(state) * (lamp[1] - lamp[0])
    sine, turn = np.sqrt(max(1 - cosine * cosine, 0.0)), lamp[2] + uniform(state) * lamp[3]
    x, y = sine * np.cos(turn), sine * np.sin(turn)
    return (m[0, 0] * x + m[1, 0] * y + m[2, 0] * cosine,
            m[0, 1] * x + m[1, 1] * y + m[2, 1] * cosine,
            m[0, 2] * x + m[1, 2] * y + m[2, 2] * cosine)


@compiled(inner=True)
def _open(  # type: ignore[no-untyped-def]
        world, other, stack, state, height, x, y, z, nx, ny, nz, gx, gy, gz):
    """Share of the room's light from a random direction about n; height: 0 along n, 1 across."""
    radius, turn = np.sqrt(height), 2 * np.pi * uniform(state)
    a, b, up = radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - height)
    ax, ay, az, bx, by, bz = _across(nx, ny, nz)
    dx, dy, dz = (a * ax + b * bx + up * nx, a * ay + b * by + up * ny,
                  a * az + b * bz + up * nz)
    if gx * dx + gy * dy + gz * dz <= 0:
        return 1.0
    kind, t, number, outside, inside = nearest(world, other, stack, x, y, z, dx, dy, dz)
    if kind == 1:
        solid = world.materials[outside][0] == 0 or world.materials[inside][0] == 0
        return _BOUNCED if solid else _THROUGH
    if kind == 2 and world.sheets[number, 16] >= 1:
        return _CORNER + (1 - _CORNER) * min(t / _CORNER_REACH, 1.0)
    return 1.0


@compiled(inner=True)
def _through(world, hit, stack, x, y, z, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Shares (red, green, blue) of a lamp's light that reach a point from the direction d.

    Light goes straight through glass; `_MIDDLE`, `_EDGE` stand for where it is bent to.
    """
    red, green, blue = 1.0, 1.0, 1.0
    for _ in range(_SHADES):
        kind, t, _, outside, inside = nearest_solid(world, hit, stack, x, y, z, dx, dy, dz)
        if kind == 0:
            break
        facing = hit[0] * dx + hit[1] * dy + hit[2] * dz
        medium = world.materials[inside if facing > 0 else outside]
        body = world.materials[outside if facing > 0 else inside]
        if body[0] == 0:
            return 0.0, 0.0, 0.0
        part = 1.0
        if body[1] != medium[1]:
            cosine = min(abs(facing), 1.0)
            share, _ = fresnel(cosine, min(body[1], medium[1]), max(body[1], medium[1]))
            part = (1 - share) * (_EDGE + (_MIDDLE - _EDGE) * cosine * cosine)
        red *= part * np.exp(-medium[2] * t)
        green *= part * np.exp(-medium[3] * t)
        blue *= part * np.exp(-medium[4] * t)
        x, y, z = x + t * dx, y + t * dy, z + t * dz
    return red, green, blue


@compiled(inner=True)
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
        r, g, b = _texel(world.textures[texture], u, v)
        share *= min(max(4 * ((r + g + b) / 3 - d[7]) / d[7], 0.0), 1.0)
    return share, texture, u, v


@compiled(inner=True)
def _texel(texture, u, v):  # type: ignore[no-untyped-def]
    """Reflectance (red, green, blue) at (u, v) [sides]."""
    size = texture.shape[0]
    u, v = (u - np.floor(u)) * size, (v - np.floor(v)) * size
    i, j = int(u), int(v)
    a, b = u - i, v - j
    i, j = i % size, j % size
    k, m = (i + 1) % size, (j + 1) % size
    w0, w1, w2, w3 = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
    return (w0 * texture[j, i, 0] + w1 * texture[j, k, 0] + w2 * texture[m, i, 0]
            + w3 * texture[m, k, 0],
            w0 * texture[j, i, 1] + w1 * texture[j, k, 1] + w2 * texture[m, i, 1]
            + w3 * texture[m, k, 1],
            w0 * texture[j, i, 2] + w1 * texture[j, k, 2] + w2 * texture[m, i, 2]
            + w3 * texture[m, k, 2])


@compiled(inner=True)
def _across(nx, ny, nz):  # type: ignore[no-untyped-def]
    """Two unit vectors at right angles to n and each other (Duff et al. 2017)."""
    sign = 1.0 if nz >= 0 else -1.0
    a = -1 / (sign + nz)
    b = nx * ny * a
    return (1 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny)


@compiled(inner=True)
def _scattered(state, sigma, nx, ny, nz):  # type: ignore[no-untyped-def]
    """A random direction about n, its slope normal with a standard deviation."""
    radius = sigma * np.sqrt(-2 * np.log(1 - uniform(state)))
    turn = 2 * np.pi * uniform(state)
    a, b = radius * np.cos(turn), radius * np.sin(turn)
    ax, ay, az, bx, by, bz = _across(nx, ny, nz)
    x, y, z = nx + a * ax + b * bx, ny + a * ay + b * by, nz + a * az + b * bz
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@compiled(inner=True)
def _tilted(state, rough, nx, ny, nz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """The normal of a facet of a rough surface that looks against d; n where none is found."""
    for _ in range(8):
        mx, my, mz = _scattered(state, rough, nx, ny, nz)
        if mx * dx + my * dy + mz * dz < -1e-3:
            return mx, my, mz
    return nx, ny, nz
