"""Draws periodic patterns: (SIZE, SIZE, 3) float32 reflectances in [0, 1]."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

SIZE = 768  # texels of a side
Texture = NDArray[np.float32]


def random_texture(rng: np.random.Generator, kinds: tuple[str, ...] = ()) -> Texture:
    """One of `kinds`, its scale and colours random; default: any of `PATTERNS`.

    Other kinds are those of `MORE`.
    """
    names = kinds or tuple(PATTERNS)
    return (PATTERNS | MORE)[names[int(rng.integers(len(names)))]](rng)


def _colours(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """(count, 3) reflectances about a common tone; they differ in brightness more than in hue."""
    tone = rng.uniform(0.15, 0.75) * (1 + rng.choice([0.05, 0.25]) * rng.standard_normal(3))
    contrast, hue = rng.choice([0.04, 0.12, 0.3]), rng.choice([0.03, 0.08, 0.2])
    return np.clip(tone + contrast * rng.standard_normal((count, 1))
                   + hue * rng.standard_normal((count, 3)), 0.02, 0.95)


def _noise(rng: np.random.Generator, slope: float, low: float, high: float,
           stretch: float = 1.0) -> NDArray[np.float64]:
    """(SIZE, SIZE) periodic noise of mean 0 and variance 1, its power as frequency ** -slope.

    low, high: limits of the frequency [cycles per side]. stretch: along the columns.
    """
    fy, fx = np.fft.fftfreq(SIZE, 1 / SIZE)[:, None], np.fft.rfftfreq(SIZE, 1 / SIZE)
    f = np.hypot(fy * stretch, fx)
    band = np.where(f > 0, np.maximum(f, low) ** (-slope / 2), 0) * np.exp(-(f / high) ** 4)
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((SIZE, SIZE))) * band,
                          s=(SIZE, SIZE))
    return np.asarray((field - field.mean()) / field.std())


def _planes(colour: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) as (3, 1, 1): by planes numpy is faster than with three values side by side."""
    return colour[:, None, None]


def _texture(planes: NDArray[np.float64]) -> Texture:
    """Of planes (3, SIZE, SIZE)."""
    return np.asarray(cv2.merge([*np.clip(planes, 0.01, 1).astype(np.float32)]), np.float32)


def clouds(rng: np.random.Generator) -> Texture:
    """Noise with the spectrum of natural images, smooth or rough."""
    high = np.exp(rng.uniform(np.log(6), np.log(200)))
    tone, *axes = _colours(rng, 4)
    picture = np.broadcast_to(_planes(tone), (3, SIZE, SIZE)).copy()
    for axis in axes:
        field = _noise(rng, rng.uniform(1, 3.5), 2, high)
        picture += 0.6 * field * _planes(axis - tone)
    return _texture(picture)


def grain(rng: np.random.Generator) -> Texture:
    """Wood or brushed stone: noise stretched along one axis."""
    a, b = _colours(rng, 2)
    field = _noise(rng, rng.uniform(1, 2.5), 2, rng.uniform(40, 150), rng.uniform(6, 25))
    return _texture(_planes(a) + (0.5 + 0.35 * field) * _planes(b - a))


def checks(rng: np.random.Generator) -> Texture:
    """Tiles of two colours or stripes, with a little wear."""
    squares = 2 * int(rng.integers(2, 9))
    k = np.arange(SIZE) * squares // SIZE
    board = (k[:, None] * rng.integers(2) + k) % 2
    a, b = _colours(rng, 2)
    wear = 1 + rng.uniform(0, 0.08) * _noise(rng, 2, 2, 120)
    return _texture((_planes(a) + board * _planes(b - a)) * wear)


def panes(rng: np.random.Generator) -> Texture:
    """Stained glass, or crazy paving: Voronoi cells with leads between them."""
    count = int(rng.integers(12, 90))
    seeds = rng.uniform(0, SIZE, (count, 2))
    y, x = np.mgrid[:SIZE:2, :SIZE:2]
    away, cell = cKDTree(seeds, boxsize=SIZE).query(
        np.stack([x, y], axis=-1).reshape(-1, 2).astype(float), k=2)
    picture = _colours(rng, count)[cell[:, 0]]
    lead = rng.uniform(2, 8)
    part = 1 / (1 + np.exp(-(away[:, 1] - away[:, 0] - lead)))[:, None]
    picture = (_colours(rng, 1) * 0.6 * (1 - part) + picture * part).reshape(*x.shape, 3)
    large = cv2.resize(picture, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)
    tint = 1 + 0.08 * _noise(rng, 2.5, 2, 60)
    return _texture(np.stack(cv2.split(large)) * tint)


def lettering(rng: np.random.Generator) -> Texture:
    """Bars, blocks and letters on a plain ground, as on a label or a page."""
    ground, *inks = np.rint(255 * _colours(rng, 6)).astype(np.uint8)
    picture = np.tile(ground, (SIZE, SIZE, 1))
    for _ in range(int(rng.integers(15, 90))):
        ink = tuple(int(each) for each in inks[int(rng.integers(5))])
        x, y = (int(each) for each in rng.integers(0, SIZE, 2))
        if rng.random() < 0.5:
            width, height = (int(each) for each in rng.integers(6, 160, 2))
            cv2.rectangle(picture, (x, y), (x + width, y + max(height // 4, 3)), ink, -1)
        else:
            text = ''.join(chr(int(each)) for each in rng.integers(65, 91, 5))
            cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, rng.uniform(0.6, 3), ink,
                        int(rng.integers(1, 6)), cv2.LINE_AA)
    picture = picture.astype(np.float32) / np.float32(255)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8), np.float32)


def plain(rng: np.random.Generator) -> Texture:
    """One colour with faint stains."""
    stain = 1 + rng.uniform(0.01, 0.06) * _noise(rng, 3, 1, 20)
    return _texture(_planes(_colours(rng, 1)[0]) * stain)


def leaves(rng: np.random.Generator) -> Texture:
    """Things that hide each other, of all sizes: sizes and edges as in photographs of clutter."""
    colours = np.rint(255 * _colours(rng, 12))
    picture = np.tile(colours[0].astype(np.uint8), (SIZE, SIZE, 1))
    for radius in np.sort(6 * rng.uniform(0.02, 1, int(rng.integers(60, 400))) ** -0.9)[::-1]:
        colour = tuple(float(each) for each in
                       (colours[rng.integers(12)] * rng.uniform(0.8, 1.2)).clip(0, 255))
        middle = rng.uniform(0, SIZE, 2)
        if rng.random() < 0.5:
            axes = radius * rng.uniform(0.3, 1, 2)
            cv2.ellipse(picture, (middle.tolist(), axes.tolist(), rng.uniform(0, 180)), colour, -1,
                        cv2.LINE_AA)
        else:
            turn = rng.uniform(0, 2 * np.pi) + np.sort(rng.uniform(0, 2 * np.pi, 4))
            corners = middle + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            cv2.fillPoly(picture, [np.rint(corners).astype(np.int32)], colour, cv2.LINE_AA)
    return picture.astype(np.float32) / np.float32(255)


def planks(rng: np.random.Generator) -> Texture:
    """Boards of grained wood side by side, with dark joints."""
    boards = int(rng.integers(3, 9))
    side = np.arange(SIZE) * boards / SIZE
    tone = 1 + rng.uniform(0, 0.25) * rng.standard_normal(boards)
    joint = np.where(np.abs(side % 1 - 0.5) > 0.5 - rng.uniform(0.002, 0.02), 0.4, 1.0)
    shade = tone[side.astype(int)] * joint
    return np.clip(grain(rng) * shade[:, None, None], 0.01, 1).astype(np.float32)


def weave(rng: np.random.Generator) -> Texture:
    """Cloth: two threads over and under each other, fine."""
    count = int(rng.integers(30, 120))
    k = np.arange(SIZE) * count / SIZE
    over = (k[:, None].astype(int) + k.astype(int)) % 2
    a, b = _colours(rng, 2)
    depth = rng.uniform(0.1, 0.5)
    bulge = 1 - depth * np.abs(np.where(over, k % 1 - 0.5, (k % 1 - 0.5)[:, None])) * 2
    return _texture((_planes(a) + rng.uniform(0, 1) * over * _planes(b - a)) * bulge)


PATTERNS: dict[str, Callable[[np.random.Generator], Texture]] = {
    'clouds': clouds, 'grain': grain, 'checks': checks, 'panes': panes, 'lettering': lettering,
    'plain': plain}
MORE: dict[str, Callable[[np.random.Generator], Texture]] = {
    'leaves': leaves, 'planks': planks, 'weave': weave}
