"""Labelled pictures of discs, as the training of the contour map takes them."""

import cv2
import numpy as np


def discs(seed, shape=(96, 112), number=4):
    """(picture, direction, inside) of opaque discs, nearer ones over farther ones.

    The direction's labels follow from the discs: the outward normal is radial.
    """
    rng = np.random.default_rng(seed)
    y, x = np.indices(shape)
    picture = np.full((*shape, 3), rng.integers(60, 200, 3), float)
    picture += rng.normal(0, 15) * np.sin(x / rng.uniform(3, 9) + y / 7)[..., None]  # texture
    direction = np.full(shape, -1, np.int8)
    inside = np.zeros(shape, bool)
    for _ in range(number):
        cx, cy = rng.uniform(0, shape[1]), rng.uniform(0, shape[0])
        radius = rng.uniform(8, 26)
        apart = np.hypot(x - cx, y - cy)
        inner, contour = apart < radius, np.abs(apart - radius) <= 0.5
        part = np.clip(radius - apart + 0.5, 0, 1)[..., None]
        colour = rng.integers(20, 235, 3) * (1 + 0.2 * (x - cx) / radius)[..., None].clip(-1, 1)
        picture = picture * (1 - part) + colour * part
        k = np.round(np.arctan2(y - cy, x - cx) / (2 * np.pi / 32)).astype(int) % 32
        direction = np.where(inner, -1, direction)
        direction = np.where(contour, k, direction).astype(np.int8)
        inside |= inner
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7) + rng.normal(0, 2, picture.shape)
    return picture.clip(0, 255).astype(np.uint8), direction, inside


def write(folder, seeds, **options):
    """One SEED.npz for each seed."""
    folder.mkdir(exist_ok=True)
    for seed in seeds:
        picture, direction, inside = discs(seed, **options)
        np.savez(folder / f'{seed:06d}.npz', picture=picture, direction=direction, inside=inside)
    return folder
