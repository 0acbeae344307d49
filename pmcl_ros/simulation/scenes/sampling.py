"""Random numbers of rays: through pixels and the pupil, about a direction, off rough surfaces."""

import numpy as np

from pmcl_ros.runtime.kernels import compiled

# Of splitmix64: 2^64 over the golden ratio, and the multipliers of its mixing.
_GOLDEN, _ONE, _TWO = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB
_STRIDE = 0xD1342543DE82EF95  # between the states of two streams
_SCALE = 2.0 ** -53  # from the 53 bits of a float's mantissa to [0, 1)
_R1, _R2 = 0.7548776662466927, 0.5698402909980532  # powers of the plane's golden ratio


@compiled(inner=True, exact=True)
def stream(seed, number):  # type: ignore[no-untyped-def]
    """The state (1,) uint64 of `uniform` for a row or block of a picture of a seed (uint64)."""
    return np.full(1, seed + np.uint64(number) * np.uint64(_STRIDE), np.uint64)


@compiled(inner=True, exact=True)
def uniform(state):  # type: ignore[no-untyped-def]
    """Uniform in [0, 1): splitmix64 (Steele, Lea, Flood 2014); state: (1,) uint64, moved on."""
    state[0] += np.uint64(_GOLDEN)
    x = state[0]
    x = (x ^ (x >> np.uint64(30))) * np.uint64(_ONE)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(_TWO)
    x = x ^ (x >> np.uint64(31))
    return np.float64(x >> np.uint64(11)) * _SCALE


@compiled(inner=True, exact=True)
def eye_ray(state, numbers, shift_x, shift_y, i, j, number):  # type: ignore[no-untyped-def]
    """(ox, oy, dx, dy, dz): a ray through pixel (i, j); it starts in the plane z = 0.

    numbers: of `render.light_of_view`. shift: of the lattice of points within pixels. number: of
    the ray among those of its column.
    """
    fx, fy, cx, cy, baseline, at_x, at_y, nominal_x, nominal_y, focus, pupil = numbers
    px, py = _in_pupil(state, nominal_x, nominal_y, pupil)
    ox, oy = baseline * px, baseline * py
    u = j + (shift_x + _R1 * number + _R2 * j) % 1 - 0.5 - cx
    v = i + (shift_y + _R2 * number + _R1 * j) % 1 - 0.5 - cy
    tx = u / fx * focus + baseline * at_x
    ty = v / fy * focus + baseline * at_y
    dx, dy, dz = tx - ox, ty - oy, focus
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    return ox, oy, dx / length, dy / length, dz / length


@compiled(inner=True, exact=True)
def _in_pupil(state, x, y, radius):  # type: ignore[no-untyped-def]
    """A random point of a view's part of the pupil [view steps]: a tent about (x, y) in a disc."""
    for _ in range(200):
        px = x + 2 * (uniform(state) + uniform(state) - 1)
        py = y + 2 * (uniform(state) + uniform(state) - 1)
        if px * px + py * py <= radius * radius:
            return px, py
    return x, y


@compiled(inner=True, exact=True)
def across(nx, ny, nz):  # type: ignore[no-untyped-def]
    """Two unit vectors at right angles to n and each other (Duff et al. 2017)."""
    sign = 1.0 if nz >= 0 else -1.0
    a = -1 / (sign + nz)
    b = nx * ny * a
    return (1 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny)


@compiled(inner=True, exact=True)
def scattered(state, sigma, nx, ny, nz):  # type: ignore[no-untyped-def]
    """A random direction about n, its slope normal with a standard deviation."""
    radius = sigma * np.sqrt(-2 * np.log(1 - uniform(state)))
    turn = 2 * np.pi * uniform(state)
    a, b = radius * np.cos(turn), radius * np.sin(turn)
    ax, ay, az, bx, by, bz = across(nx, ny, nz)
    x, y, z = nx + a * ax + b * bx, ny + a * ay + b * by, nz + a * az + b * bz
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@compiled(inner=True, exact=True)
def tilted(state, rough, nx, ny, nz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """The normal of a facet of a rough surface that looks against d; n where none is found."""
    for _ in range(8):
        mx, my, mz = scattered(state, rough, nx, ny, nz)
        if mx * dx + my * dy + mz * dz < -1e-3:
            return mx, my, mz
    return nx, ny, nz
