"""Synthetic light fields: noise, and textured planes that every view shows exactly."""

import numpy as np

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions


def make_grid(views=(3, 3), size=(24, 20), baseline=0.01, jitter=0.0, focal=(100.0, 90.0), seed=0):
    """A grid of (rows, columns) views of (width, height) px, positions off nominal by `jitter`."""
    positions = nominal_positions(*views)
    positions += np.random.default_rng(seed).normal(0, 1, positions.shape) * jitter
    positions[views[0] // 2, views[1] // 2] = 0
    pinhole = Pinhole(*size, *focal, (size[0] - 1) / 2, (size[1] - 1) / 2)
    return ViewGrid(pinhole, baseline, positions, np.ones(views, np.float32))


def noise_field(grid, seed=0, sigma=None, gamma=1 / 2.4):
    """Uniform noise, or a grey of 0.5 with Gaussian noise of `sigma` (in encoded intensity)."""
    rng = np.random.default_rng(seed)
    shape = (*grid.shape, grid.pinhole.height, grid.pinhole.width, 3)
    encoded = rng.random(shape) if sigma is None else 0.5 + rng.normal(0, sigma, shape)
    return LightField(Header(), (encoded ** (1 / gamma)).astype(np.float32), grid, gamma)


class Texture:
    """A sum of sines of up to `highest` cycles per px, in [0.1, 0.9]: known between pixels too."""

    def __init__(self, seed, highest=0.12, waves=8):
        rng = np.random.default_rng(seed)
        angle = rng.uniform(0, 2 * np.pi, waves)
        frequency = rng.uniform(0.25, 1, waves) * highest * 2 * np.pi
        self.wave = np.stack([frequency * np.cos(angle), frequency * np.sin(angle)])
        self.phase = rng.uniform(0, 2 * np.pi, (3, waves))

    def __call__(self, x, y):
        """Encoded RGB at pixels (x, y) of the centre view."""
        phase = x[..., None] * self.wave[0] + y[..., None] * self.wave[1]
        return 0.5 + 0.4 * np.sin(phase[..., None, :] + self.phase).mean(-1)

    def on_grid(self, x, y):
        """(m, n, 3) at columns x (n,) and rows y (m,): many times as quick."""
        across, down = (np.exp(1j * np.multiply.outer(at, wave))
                        for at, wave in zip((x, y), self.wave, strict=True))
        shifted = np.exp(1j * self.phase)[:, None] * across  # (3, n, waves)
        sums = (down @ shifted.swapaxes(1, 2)).imag
        return 0.5 + 0.4 * sums.transpose(1, 2, 0) / self.wave.shape[1]


def planes_field(grid, far, near, split, gamma=1 / 2.4, seed=0, highest=0.12):
    """A far plane [m] left of column `split` of the centre view, a near one right of it."""
    pinhole = grid.pinhole
    x, y = np.arange(float(pinhole.width)), np.arange(float(pinhole.height))
    textures = Texture(seed, highest), Texture(seed + 1, highest)
    views = np.empty((*grid.shape, pinhole.height, pinhole.width, 3), np.float32)
    for row, column in np.ndindex(grid.shape):
        a, b = grid.positions[row, column] * grid.baseline * (pinhole.fx, pinhole.fy)
        encoded = textures[0].on_grid(x + a / far, y + b / far)
        front = x + a / near >= split
        encoded[:, front] = textures[1].on_grid(x[front] + a / near, y + b / near)
        views[row, column] = encoded ** (1 / gamma)
    return LightField(Header(), views, grid, gamma)
