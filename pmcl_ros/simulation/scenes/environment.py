"""The light of a room: a panorama at infinity with windows, lamps and dark furniture."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.kernels import compiled

_HEIGHT = 256  # rows of a panorama


@dataclass(frozen=True)
class Environment:
    """Radiance from every direction.

    panorama: (rows, 2 rows, 3) float32; row 0 is straight up (world +z), the last row down; column
        0 is -x, columns turn from there towards -y.
    lamps: (n, 7) rectangles in the panorama that cast shadows: polar angles from and to, azimuth
        at the start and its width [rad], radiance of red, green, blue. unlit: the panorama
        without them, where there are any. With no lamps there are no shadows.
    """

    panorama: NDArray[np.float32]
    lamps: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7)))
    unlit: NDArray[np.float32] | None = None

    def irradiance(self, camera_from_world: NDArray[np.floating]) -> NDArray[np.float64]:
        """(9, 3) coefficients of `shade`, for normals in the camera's frame.

        A white surface of normal n sends out the radiance basis(n) @ coefficients: the panorama
        folded with a cosine, which nine spherical harmonics hold to 1 % (Ramamoorthi and
        Hanrahan, An efficient representation for irradiance environment maps, 2001).
        """
        rows, columns = self.panorama.shape[:2]
        polar = (np.arange(rows) + 0.5) * np.pi / rows
        turn = (np.arange(columns) + 0.5) * 2 * np.pi / columns - np.pi
        sine = np.sin(polar)[:, None]
        world = np.stack([sine * np.cos(turn), sine * np.sin(turn),
                          np.cos(polar)[:, None] + 0 * turn], axis=-1)
        solid = sine[..., None] * (np.pi / rows) * (2 * np.pi / columns)
        basis = _harmonics(world @ camera_from_world.T)
        moments = np.einsum('rcb,rcl->bl', basis, self.panorama * solid)
        band = np.array([1, 2 / 3, 2 / 3, 2 / 3, 0.25, 0.25, 0.25, 0.25, 0.25])
        return np.asarray(band[:, None] * moments)


def _harmonics(n: NDArray[np.floating]) -> NDArray[np.float64]:
    """(..., 9) real spherical harmonics of unit vectors (..., 3)."""
    x, y, z = np.moveaxis(n, -1, 0)
    return np.stack([0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x,
                     1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z * z - 1),
                     1.092548 * x * z, 0.546274 * (x * x - y * y)], axis=-1)


def random_environment(rng: np.random.Generator) -> Environment:
    """Draw a grey room, darker towards the floor, with one to five lights and dark furniture."""
    rows, columns = _HEIGHT, 2 * _HEIGHT
    up = np.cos((np.arange(rows) + 0.5) * np.pi / rows)[:, None, None]
    tone = rng.uniform(0.25, 0.6) * (1 + 0.12 * rng.standard_normal(3))
    room = tone * (1 + rng.uniform(0, 0.6) * up)
    picture = np.broadcast_to(room, (rows, columns, 3)).copy()
    for _ in range(int(rng.integers(2, 10))):
        _paint(picture, rng, (0.35, 0.9), (0.05, 0.4), room.mean() * rng.uniform(0.1, 1.4, 3))
    for _ in range(int(rng.integers(1, 6))):
        light = np.exp(rng.uniform(np.log(2), np.log(30))) * (1 + 0.1 * rng.standard_normal(3))
        _paint(picture, rng, (0.05, 0.42), (0.02, 0.2), light, bars=int(rng.integers(0, 3)))
    return Environment(np.clip(picture, 0.005, None).astype(np.float32))


def random_lit_environment(rng: np.random.Generator) -> Environment:
    """Draw a room with one to four lamps that cast shadows: panels, windows, bulbs.

    A quarter of the rooms is bright and even, as a studio; others have furniture, out of focus.
    The lamps give a table 0.3 to 5 times as much light as the rest of the room.
    """
    rows, columns = _HEIGHT, 2 * _HEIGHT
    polar = (np.arange(rows) + 0.5) * np.pi / rows
    studio = rng.random() < 0.25
    tone = rng.uniform(0.5, 0.9) if studio else np.exp(rng.uniform(np.log(0.06), np.log(0.6)))
    room = tone * (1 + rng.choice([0.03, 0.12]) * rng.standard_normal(3)) * (
        1 + rng.uniform(0, 0.7) * np.cos(polar)[:, None, None])
    unlit = np.broadcast_to(np.clip(room, 0.01, None), (rows, columns, 3)).copy()
    for _ in range(int(rng.integers(0, 3 if studio else 25))):
        colour = unlit.mean() * np.exp(rng.normal(-0.2, 0.6) + rng.normal(0, 0.2, 3))
        _paint(unlit, rng, (0.2, 0.9), (0.02, 0.4), colour)
    blur = float(np.exp(rng.uniform(np.log(0.5), np.log(6))))
    unlit = cv2.GaussianBlur(unlit, (0, 0), blur)
    lamps = np.array([_lamp(rng) for _ in range(int(rng.integers(1, 5)))])
    cosines = np.cos(lamps[:, :2])
    onto_table = 0.5 * (cosines[:, :1] ** 2 - cosines[:, 1:] ** 2) * lamps[:, 3:4] / np.pi
    above = np.clip(np.cos(polar), 0, None) * np.sin(polar)
    ambient = float((unlit.mean(axis=(1, 2)) * above).sum() / above.sum())
    direct = float((onto_table * lamps[:, 4:].mean(axis=1, keepdims=True)).sum())
    lamps[:, 4:] *= np.exp(rng.uniform(np.log(0.3), np.log(5))) * ambient / direct
    panorama = unlit.copy()
    for top, bottom, left, width, *colour in lamps:
        across = np.rint((left + np.array([0, width])) * columns / (2 * np.pi)).astype(int)
        down = slice(*np.rint(np.array([top, bottom]) * rows / np.pi).astype(int).tolist())
        panorama[down, np.arange(*across) % columns] = colour
    lamps[:, 2] -= np.pi
    return Environment(panorama.astype(np.float32), lamps, unlit.astype(np.float32))


def _lamp(rng: np.random.Generator) -> NDArray[np.float64]:
    """(7,) as of `Environment`, at whole texels; the azimuth is that of a column; brightness is
    relative.
    """
    kind = rng.choice(3, p=[0.4, 0.35, 0.25])
    between, sizes = (((0.02, 0.3), (0.05, 0.25)), ((0.2, 0.38), (0.08, 0.3)),
                      ((0.05, 0.42), (0.008, 0.03)))[kind]
    height, width = (max(2, int(_HEIGHT * each)) for each in rng.uniform(*sizes, 2))
    top, left = int(_HEIGHT * rng.uniform(*between)), int(rng.integers(2 * _HEIGHT))
    bottom = min(top + height, int(0.49 * _HEIGHT))
    warm = rng.normal(0, 0.15)
    colour = np.array([1 + warm, 1, 1 - warm]).clip(0.4) / ((bottom - top) * width)
    size = np.pi / _HEIGHT
    return np.array([top * size, bottom * size, left * size, width * size,
                     *(colour * np.exp(rng.normal(0, 0.8)))])


def _paint(picture: NDArray[np.float64], rng: np.random.Generator, between: tuple[float, float],
           sizes: tuple[float, float], colour: NDArray[np.floating], bars: int = 0) -> None:
    """Paint a rectangle at a random place, of a random size (shares of the height).

    bars: of a window's frame.
    """
    rows, columns = picture.shape[:2]
    height, width = (max(3, int(rows * each)) for each in rng.uniform(*sizes, 2))
    top = int(rows * rng.uniform(*between))
    left = int(rng.integers(columns))
    where = np.ix_(np.arange(top, min(top + height, rows)),
                   np.arange(left, left + width) % columns)
    before = picture[where].copy()
    picture[where] = colour
    for k in range(1, bars + 1):
        middle = k * width // (bars + 1)
        inner = np.ix_(where[0].ravel(), np.arange(left + middle, left + middle + 2) % columns)
        picture[inner] = before[:, :2] if before.shape[1] > 1 else before


@compiled(exact=True)
def look_up(panorama, x, y, z):  # type: ignore[no-untyped-def]
    """Radiance (red, green, blue) from the unit direction (x, y, z) of the world."""
    rows, columns = panorama.shape[0], panorama.shape[1]
    v = np.arccos(min(max(z, -1.0), 1.0)) / np.pi * rows - 0.5
    u = (np.arctan2(y, x) + np.pi) / (2 * np.pi) * columns - 0.5
    j, i = int(np.floor(v)), int(np.floor(u))
    b, a = v - j, u - i
    top, bottom = min(max(j, 0), rows - 1), min(max(j + 1, 0), rows - 1)
    left, right = i % columns, (i + 1) % columns
    one, two, three, four = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
    return (one * panorama[top, left, 0] + two * panorama[top, right, 0]
            + three * panorama[bottom, left, 0] + four * panorama[bottom, right, 0],
            one * panorama[top, left, 1] + two * panorama[top, right, 1]
            + three * panorama[bottom, left, 1] + four * panorama[bottom, right, 1],
            one * panorama[top, left, 2] + two * panorama[top, right, 2]
            + three * panorama[bottom, left, 2] + four * panorama[bottom, right, 2])


@compiled(exact=True)
def shade(c, x, y, z):  # type: ignore[no-untyped-def]
    """Radiance (red, green, blue) that a white surface of normal (x, y, z) sends out.

    c: of `Environment.irradiance`.
    """
    b1, b2, b3 = 0.488603 * y, 0.488603 * z, 0.488603 * x
    b4, b5 = 1.092548 * x * y, 1.092548 * y * z
    b6, b7, b8 = 0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y)
    red = (0.282095 * c[0, 0] + b1 * c[1, 0] + b2 * c[2, 0] + b3 * c[3, 0] + b4 * c[4, 0]
           + b5 * c[5, 0] + b6 * c[6, 0] + b7 * c[7, 0] + b8 * c[8, 0])
    green = (0.282095 * c[0, 1] + b1 * c[1, 1] + b2 * c[2, 1] + b3 * c[3, 1] + b4 * c[4, 1]
             + b5 * c[5, 1] + b6 * c[6, 1] + b7 * c[7, 1] + b8 * c[8, 1])
    blue = (0.282095 * c[0, 2] + b1 * c[1, 2] + b2 * c[2, 2] + b3 * c[3, 2] + b4 * c[4, 2]
            + b5 * c[5, 2] + b6 * c[6, 2] + b7 * c[7, 2] + b8 * c[8, 2])
    return max(red, 0.0), max(green, 0.0), max(blue, 0.0)
