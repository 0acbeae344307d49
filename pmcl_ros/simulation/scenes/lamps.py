"""The light that reaches a point from lamps and the room, past what casts shadows."""

import numpy as np

from pmcl_ros.runtime.kernels import compiled
from pmcl_ros.simulation.scenes.environment import shade
from pmcl_ros.simulation.scenes.materials import fresnel
from pmcl_ros.simulation.scenes.sampling import across, uniform
from pmcl_ros.simulation.scenes.trace import nearest, nearest_solid

_SHADES = 16  # surfaces between a point and a lamp at most
_RAYS = 4  # to the lamps and the room in half shadow
_CLEAR = 0.03  # there is no half shadow where this share of the light is missing, or is there
_FORGOTTEN = 0.25  # share of what a point tells about its neighbours
_OFF = 1e-5  # m: where rays to the light start, above the surface
_BOUNCED = 0.3  # share of the room's light that an opaque thing sends back
_THROUGH = 0.85  # share of the room's light that comes through glass
_CORNER, _CORNER_REACH = 0.55, 0.4  # that of a sheet which is touched, and where it is 1 [m]
# Light that comes through glass at right angles and at grazing ones: what is bent away at its
# edges lands in the middle of its shadow.
_MIDDLE, _EDGE = 1.1, 0.3


@compiled(inner=True, exact=True)
def irradiated(  # type: ignore[no-untyped-def]
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


@compiled(inner=True, exact=True)
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


@compiled(inner=True, exact=True)
def _open(  # type: ignore[no-untyped-def]
        world, other, stack, state, height, x, y, z, nx, ny, nz, gx, gy, gz):
    """Share of the room's light from a random direction about n; height: 0 along n, 1 across."""
    radius, turn = np.sqrt(height), 2 * np.pi * uniform(state)
    a, b, up = radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - height)
    ax, ay, az, bx, by, bz = across(nx, ny, nz)
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


@compiled(inner=True, exact=True)
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
