"""What a smooth surface does to light: Snell's law and Fresnel's equations."""

import math

from pmcl_ros.runtime.kernels import compiled


@compiled()
def fresnel(cosine, n_from, n_to):  # type: ignore[no-untyped-def]
    """(share of unpolarised light reflected, cosine of the refracted ray).

    cosine: of the angle of incidence, 0 to 1. n_from, n_to: refractive indices. Total reflection
    gives (1, 0).
    """
    ratio = n_from / n_to
    square = 1 - ratio * ratio * (1 - cosine * cosine)
    if square <= 0:
        return 1.0, 0.0
    inside = math.sqrt(square)
    across = (n_from * cosine - n_to * inside) / (n_from * cosine + n_to * inside)
    along = (n_from * inside - n_to * cosine) / (n_from * inside + n_to * cosine)
    return 0.5 * (across * across + along * along), inside


@compiled()
def reflected(dx, dy, dz, nx, ny, nz):  # type: ignore[no-untyped-def]
    """The direction d mirrored by a surface of normal n, both of length 1."""
    twice = 2 * (dx * nx + dy * ny + dz * nz)
    return dx - twice * nx, dy - twice * ny, dz - twice * nz


@compiled()
def refracted(dx, dy, dz, nx, ny, nz, ratio, cosine, inside):  # type: ignore[no-untyped-def]
    """The direction d behind a surface whose normal n points against it.

    ratio: n_from / n_to; cosine, inside: of `fresnel`.
    """
    k = ratio * cosine - inside
    return ratio * dx + k * nx, ratio * dy + k * ny, ratio * dz + k * nz
