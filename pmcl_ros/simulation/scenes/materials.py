"""What objects are made of, and how their surfaces reflect and refract light."""

import math
from dataclasses import dataclass

import numpy as np

from pmcl_ros.runtime.kernels import compiled
from pmcl_ros.simulation.scenes.textures import Texture


@dataclass(frozen=True)
class Clear:
    """A transparent medium.

    index: refractive index. absorption: of red, green, blue [1/m]. roughness: of its surface,
    standard deviation of the normal's slope, where scenes have lamps; else it is smooth.
    """

    index: float = 1.0
    absorption: tuple[float, float, float] = (0.0, 0.0, 0.0)
    roughness: float = 0.0


AIR = Clear()


@dataclass(frozen=True)
class Opaque:
    """A matt, textured surface under a clear coat.

    texture: reflectance around the z axis of the object (columns) and along it (rows). side: of
    one period of the texture [m]. coat: refractive index of the coat, which reflects by Fresnel's
    equations; 1: no coat. roughness: of the coat, as in `Clear`.
    """

    texture: Texture
    side: float = 0.1
    coat: float = 1.0
    roughness: float = 0.0


Medium = Clear | Opaque


def random_glass(rng: np.random.Generator) -> Clear:
    """Draw soda-lime to lead glass or clear plastic, one in four tinted."""
    absorption = rng.uniform(0, 8) + rng.uniform(0, 4, 3)
    if rng.random() < 0.25:
        absorption += rng.uniform(0, 150, 3)
    red, green, blue = (float(each) for each in absorption)
    return Clear(float(rng.uniform(1.46, 1.58)), (red, green, blue))


def random_liquid(rng: np.random.Generator) -> Clear:
    """Draw clear (60 %) or coloured water."""
    absorption = rng.uniform(0, 25, 3) if rng.random() < 0.4 else np.zeros(3)
    red, green, blue = (float(each) for each in absorption)
    return Clear(1.333, (red, green, blue))


@compiled(exact=True)
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


@compiled(exact=True)
def reflected(dx, dy, dz, nx, ny, nz):  # type: ignore[no-untyped-def]
    """The direction d mirrored by a surface of normal n, both of length 1."""
    twice = 2 * (dx * nx + dy * ny + dz * nz)
    return dx - twice * nx, dy - twice * ny, dz - twice * nz


@compiled(exact=True)
def refracted(dx, dy, dz, nx, ny, nz, ratio, cosine, inside):  # type: ignore[no-untyped-def]
    """The direction d behind a surface whose normal n points against it.

    ratio: n_from / n_to; cosine, inside: of `fresnel`.
    """
    k = ratio * cosine - inside
    return ratio * dx + k * nx, ratio * dy + k * ny, ratio * dz + k * nz
