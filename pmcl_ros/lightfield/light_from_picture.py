"""The light at each pixel under its lenslet, from an ordinary picture instead of a white image."""

import logging
import math

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.runtime.errors import LightFieldError
from pmcl_ros.runtime.kernels import compiled

_LOG = logging.getLogger(__name__)

_INNER = 0.3  # pitches: radius of the disc in which a lenslet's own brightness is measured
_BINS = 4  # of the profile, per raw px
_TILES = 16  # of the sensor, per side
_ORDER = 4  # of the polynomial across the sensor
_SATURATED = 0.98  # of the sensor's range
_FAINT = 0.01  # of the sensor's range: about the noise of a pixel in the dark
# Relative: how much the pixels of a lenslet that sees an even surface differ (noise and profile).
_EVEN = 0.05
_SPREAD = 0.3  # expected variation of the profile across the sensor, before any measurement
_ROUNDS = 3  # each weighs ratios by the profile of the one before; the first by none
_LEAST = 1000  # lenslets


def light_from_picture(frame: RawFrame, lattice: Lattice) -> NDArray[np.float32]:
    """(height, width) float32: the light each pixel got, 1 at most, as `relative_light`.

    The scene cancels: under every lenslet a pixel is compared with the lenslet's own middle, and
    the ratios of many lenslets are averaged for each place within the disc. This profile varies
    across the sensor as a polynomial of fourth order. Each colour has its own profile, since a
    real lenslet refracts colours differently. Lenslets on even surfaces get the largest weights,
    saturated ones none, and ratios far from the profile small ones. The fall of light from the
    sensor's middle to its corners is unknown without a white image, and remains in the views.
    Raises LightFieldError when too few lenslets see light without being saturated.
    """
    light = frame.linear()
    height, width = light.shape
    i0, i1, j0, j1 = lattice.index_range(width, height)
    centres = lattice.centres(*np.meshgrid(np.arange(i0, i1), np.arange(j0, j1)))
    reach = math.ceil(0.6 * lattice.pitch_px) + 1  # raw px: beyond a cell's corner
    middles, worth = _middles(light, centres, _INNER * lattice.pitch_px, lattice.pitch_px / 2)
    lenslets = int((worth > 0).sum())
    if lenslets < _LEAST:
        raise LightFieldError(f'only {lenslets} lenslets of the picture see light without being '
                              f'saturated, {_LEAST} are needed for a profile; give a white image '
                              'or a better exposed picture')
    bins = 2 * reach * _BINS + 1
    nodes = np.ones((3, _TILES + 1, _TILES + 1, bins, bins), np.float32)
    spread = np.float32(np.inf)
    for _ in range(_ROUNDS):
        sums, weights, squares = _profiles(light, centres, middles, worth, lattice.pitch_px, reach,
                                           nodes, spread)
        nodes = np.stack([_smooth(*each) for each in zip(sums, weights, strict=True)])
        spread = np.float32(2 * math.sqrt(squares.sum() / weights.sum()))
    shape = _light_map(height, width, lattice.pitch_px, lattice.row_step_px, lattice.rotation,
                       *lattice.centre_px, reach, nodes)
    _LOG.info('profile of the light under a lenslet from %d lenslets of the picture', lenslets)
    brightest = np.float32(np.percentile(shape[::8, ::8], 99))
    return np.asarray(np.maximum(shape / brightest, 0), np.float32)


def _smooth(sums: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float32]:
    """(tiles + 1, tiles + 1, bins, bins) profile of a colour at the corners of the tiles.

    sums, weights: (tiles, tiles, bins, bins) of the ratios measured in each tile.
    A polynomial for each bin, regularised to zero where little was measured.
    """
    powers = [(a, b) for a in range(_ORDER + 1) for b in range(_ORDER + 1 - a)]

    def terms(places: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.outer(places ** a, places ** b).ravel() for a, b in powers], axis=1)

    tiles, bins = sums.shape[0], sums.shape[2]
    middles = terms((np.arange(tiles) + 0.5) * 2 / tiles - 1)
    flat = weights.reshape(tiles ** 2, -1)
    prior = np.diag([1e-6 if a + b == 0 else (max(a + b, 1) / _SPREAD) ** 2 for a, b in powers])
    normal = np.einsum('tp,tn,tq->npq', middles, flat, middles, optimize=True) + prior
    right = np.einsum('tp,tn->np', middles, sums.reshape(tiles ** 2, -1), optimize=True)
    coefficients = np.linalg.solve(normal, right[..., None])[..., 0]
    corners = terms(np.arange(tiles + 1) * 2 / tiles - 1) @ coefficients.T
    return corners.reshape(tiles + 1, tiles + 1, bins, bins).astype(np.float32)


@compiled()
def _middles(light, centres, inner, radius):  # type: ignore[no-untyped-def]
    """Mean light in the middle of each lenslet, by phase of the mosaic, and its weight."""
    height, width = light.shape
    rows, columns = centres.shape[:2]
    middles = np.zeros((rows, columns, 4), np.float32)
    worth = np.zeros((rows, columns), np.float32)
    for j in range(rows):
        for i in range(columns):
            cx, cy = centres[j, i, 0], centres[j, i, 1]
            if cx < radius or cy < radius or cx > width - 1 - radius or cy > height - 1 - radius:
                continue
            total, square, count = np.zeros(4), np.zeros(4), np.zeros(4)
            saturated = False
            for v in range(math.ceil(cy - radius), math.floor(cy + radius) + 1):
                for u in range(math.ceil(cx - radius), math.floor(cx + radius) + 1):
                    apart = (u - cx) ** 2 + (v - cy) ** 2
                    value = light[v, u]
                    if apart > radius ** 2:
                        continue
                    if value > _SATURATED:
                        saturated = True
                    if apart <= inner ** 2:
                        k = 2 * (v % 2) + u % 2
                        total[k] += value
                        square[k] += value * value
                        count[k] += 1
            if saturated or count.min() < 2:
                continue
            uneven = 0.0
            least = 1e9
            for k in range(4):
                mean = total[k] / count[k]
                middles[j, i, k] = mean
                least = min(least, mean)
                uneven += max(square[k] / count[k] - mean * mean, 0) / 4 / max(mean, 1e-4) ** 2
            if least > _FAINT:
                worth[j, i] = 1 / (_EVEN ** 2 + uneven + (_FAINT / least) ** 2)
    return middles, worth


@compiled()
def _profiles(light, centres, middles, worth, pitch, reach,  # type: ignore[no-untyped-def]
              nodes, spread):
    """Sums of ratios to the lenslet's middle, by tile of the sensor and place within the cell."""
    height, width = light.shape
    rows, columns = centres.shape[:2]
    tiles, bins = nodes.shape[1] - 1, nodes.shape[3]
    sums = np.zeros((3, tiles, tiles, bins, bins))
    weights = np.zeros((3, tiles, tiles, bins, bins))
    squares = np.zeros((tiles, tiles))
    for ty in range(tiles):
        for j in range(rows):
            for i in range(columns):
                w = worth[j, i]
                cx, cy = centres[j, i, 0], centres[j, i, 1]
                if w == 0 or int(cy * tiles / height) != ty:
                    continue
                tx = int(cx * tiles / width)
                for v in range(max(math.ceil(cy - reach), 0),
                               min(math.floor(cy + reach) + 1, height)):
                    for u in range(max(math.ceil(cx - reach), 0),
                                   min(math.floor(cx + reach) + 1, width)):
                        dx, dy = u - cx, v - cy
                        # Of the lenslet's own cell (a hexagon; rotated by little), no other's.
                        if (abs(dx) > pitch / 2
                                or abs(dx) / 2 + abs(dy) * 0.8660254 > pitch / 2):
                            continue
                        bx = round((dx + reach) * _BINS)
                        by = round((dy + reach) * _BINS)
                        ratio = light[v, u] / middles[j, i, 2 * (v % 2) + u % 2]
                        c = 1 if v % 2 != u % 2 else 0 if v % 2 else 2  # BGGR
                        off = ratio - nodes[c, ty, tx, by, bx]
                        trust = w / (1 + (off / spread) ** 2) ** 2
                        sums[c, ty, tx, by, bx] += trust * ratio
                        weights[c, ty, tx, by, bx] += trust
                        squares[ty, tx] += trust * min(off * off, 1.0)
    return sums, weights, squares


@compiled()
def _light_map(height, width, pitch, row_step, rotation, cx, cy,  # type: ignore[no-untyped-def]
               reach, nodes):
    """The profile at every pixel: bilinear between tiles' corners and between bins."""
    out = np.zeros((height, width), np.float32)
    tiles = nodes.shape[1] - 1
    cos, sin = math.cos(rotation), math.sin(rotation)
    for y in range(height):
        for x in range(width):
            along = (cos * (x - cx) + sin * (y - cy)) / pitch
            across = (cos * (y - cy) - sin * (x - cx)) / row_step
            nearest = 1e9
            p, q = 0.0, 0.0
            first = math.floor(across)
            for j in range(first, first + 2):
                half = 0.5 * (j % 2)
                a = (along - half - round(along - half)) * pitch
                b = (across - j) * row_step
                if a * a + b * b < nearest:
                    nearest, p, q = a * a + b * b, a, b
            bx = (cos * p - sin * q + reach) * _BINS
            by = (sin * p + cos * q + reach) * _BINS
            gx, gy = x * tiles / width, y * tiles / height
            u, v, s, t = int(bx), int(by), int(gx), int(gy)
            fu, fv, fs, ft = bx - u, by - v, gx - s, gy - t
            c = 1 if y % 2 != x % 2 else 0 if y % 2 else 2
            value = 0.0
            for dt in range(2):
                wt = ft if dt else 1 - ft
                for ds in range(2):
                    ws = wt * (fs if ds else 1 - fs)
                    for dv in range(2):
                        wv = ws * (fv if dv else 1 - fv)
                        value += wv * ((1 - fu) * nodes[c, t + dt, s + ds, v + dv, u]
                                       + fu * nodes[c, t + dt, s + ds, v + dv, u + 1])
            out[y, x] = value
    return out
