"""What things are made of."""

from dataclasses import dataclass

import numpy as np

from pmcl_ros.simulation.scenes.textures import Texture


@dataclass(frozen=True)
class Clear:
    """A medium that light goes through.

    index: refractive index. absorption: of red, green, blue [1/m].
    """

    index: float = 1.0
    absorption: tuple[float, float, float] = (0.0, 0.0, 0.0)


AIR = Clear()


@dataclass(frozen=True)
class Opaque:
    """A matt ground of a texture's reflectance, under a clear coat unless coat is 1.

    texture: seen around the z axis of the object (columns) and along it (rows). side: of one
    texture [m]. coat: refractive index of a smooth coat that mirrors as Fresnel says.
    """

    texture: Texture
    side: float = 0.1
    coat: float = 1.0


Medium = Clear | Opaque


def random_glass(rng: np.random.Generator) -> Clear:
    """Soda-lime to lead glass or clear plastic, sometimes tinted."""
    absorption = rng.uniform(0, 8) + rng.uniform(0, 4, 3)
    if rng.random() < 0.25:
        absorption += rng.uniform(0, 150, 3)
    red, green, blue = (float(each) for each in absorption)
    return Clear(float(rng.uniform(1.46, 1.58)), (red, green, blue))


def random_liquid(rng: np.random.Generator) -> Clear:
    """Water, or something that colours it."""
    absorption = rng.uniform(0, 25, 3) if rng.random() < 0.4 else np.zeros(3)
    red, green, blue = (float(each) for each in absorption)
    return Clear(1.333, (red, green, blue))
