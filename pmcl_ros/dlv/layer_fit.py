"""Fit of two layers along each ray: sums over its window, and the likelihoods of both models."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.view_moments import CONSTANT, FIRST, REST, SECOND, ViewMoments
from pmcl_ros.runtime.kernels import compiled, rounds

REACH = 3  # px: of the derivatives' weights, exact for polynomials up to the sixth degree

# Weights of the pixels from -3 to 3 for the derivatives of order 0 to 4.
_DERIVATIVES = np.array([[0, 0, 0, 1, 0, 0, 0],
                         np.array([-1, 9, -45, 0, 45, -9, 1]) / 60,
                         np.array([2, -27, 270, -490, 270, -27, 2]) / 180,
                         np.array([1, -8, 13, 0, -13, 8, -1]) / 8,
                         np.array([-1, 12, -39, 56, -39, 12, -1]) / 6], np.float32)

# Sums over a window, named by the factors of the products (`_multiply`).
LL, LD, LE, LQ, DD, DE, DQ, EE, EQ, QQ, OO, OG, GG, NN = range(14)
SUMS = 14  # of those in a pixel
_LEAST = 1e-9  # divisors without contrast


def window_sums(pictures: NDArray[np.float32], moments: ViewMoments, half: int, stride: int
                 ) -> NDArray[np.float32]:
    """(SUMS, rows, columns) products of the refocused pictures' parts, summed over the window.

    pictures: (moments, 3, height, width) of `refocused_moments`, with `half` + `REACH` pixels
    around those that count. half: of the window, less its middle [px]. stride: of the pixels kept.
    """
    height, width = (size - 2 * REACH for size in pictures.shape[2:])
    products = np.empty((SUMS, height, width), np.float32)
    second = np.linalg.cholesky(np.linalg.inv(moments.covariance[SECOND, SECOND])).T
    first = np.linalg.cholesky(np.linalg.inv(moments.covariance[FIRST, FIRST])).T
    _multiply(pictures[CONSTANT][0], pictures[FIRST], pictures[SECOND], pictures[REST],
              first.astype(np.float32), second.astype(np.float32),
              (second @ moments.fourth()).astype(np.float32), _DERIVATIVES, products)
    side = 2 * half + 1
    inside = np.s_[half:height - half:stride, half:width - half:stride]
    return np.stack([cv2.boxFilter(each, -1, (side, side), normalize=False)[inside]
                     for each in products])


@compiled(parallel=True)
def _multiply(constant, first, second, rest, white_first,  # type: ignore[no-untyped-def]
              white_second, fourth, derivatives, products, portion):
    """Products of what a pixel holds, all in units of the noise.

    L, O: the second- and first-degree parts. G, D, Q: what h, h^2, h^4 make of the constant part's
    first, second, fourth derivatives. E: what half the sum of both displacements makes of the
    first-degree part's first derivatives.
    """
    _, height, width = products.shape
    for y in rounds(height, portion):
        products[:, y] = 0
        down = np.empty((5, width + 2 * REACH), np.float32)
        for channel in range(3):
            _vertical(constant[channel], y, derivatives, down)
            for x in range(width):
                i = x + REACH
                dx, xx, x4 = np.float32(0), np.float32(0), np.float32(0)
                xy, xxxy, xxyy, xyyy = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
                for k in range(2 * REACH + 1):
                    d1, d2 = derivatives[1, k], derivatives[2, k]
                    dx += d1 * down[0, x + k]
                    xx += d2 * down[0, x + k]
                    x4 += derivatives[4, k] * down[0, x + k]
                    xy += d1 * down[1, x + k]
                    xxxy += derivatives[3, k] * down[1, x + k]
                    xxyy += d2 * down[2, x + k]
                    xyyy += d1 * down[3, x + k]
                dy, yy, y4 = down[1, i], down[2, i], down[4, i]
                ax, ay, bx, by = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
                for k in range(2 * REACH + 1):
                    d1 = derivatives[1, k]
                    ax += d1 * first[0, channel, y + REACH, x + k]
                    bx += d1 * first[1, channel, y + REACH, x + k]
                    ay += d1 * first[0, channel, y + k, i]
                    by += d1 * first[1, channel, y + k, i]
                half = np.float32(0.5)
                for r in range(3):
                    a, b, c = white_second[r, 0], white_second[r, 1], white_second[r, 2]
                    lr = (a * second[0, channel, y + REACH, i]
                          + b * second[1, channel, y + REACH, i]
                          + c * second[2, channel, y + REACH, i])
                    dr = half * a * xx + b * xy + half * c * yy
                    er = a * ax + b * (ay + bx) + c * by
                    qr = (fourth[r, 0] * x4 + fourth[r, 1] * xxxy + fourth[r, 2] * xxyy
                          + fourth[r, 3] * xyyy + fourth[r, 4] * y4)
                    _add_products(products, y, x, lr, dr, er, qr)
                for r in range(2):
                    a, b = white_first[r, 0], white_first[r, 1]
                    odd = (a * first[0, channel, y + REACH, i]
                           + b * first[1, channel, y + REACH, i])
                    slope = a * dx + b * dy
                    products[OO, y, x] += odd * odd
                    products[OG, y, x] += odd * slope
                    products[GG, y, x] += slope * slope
                    noise = rest[r, channel, y + REACH, i]
                    products[NN, y, x] += noise * noise


@compiled(inlined=True, inner=True)
def _vertical(plane, y, derivatives, down):  # type: ignore[no-untyped-def]
    """Write into down (5, width) the values of a row and their four derivatives down."""
    down[:] = 0
    for order in range(5):
        for k in range(2 * REACH + 1):
            weight, row = derivatives[order, k], plane[y + k]
            for x in range(down.shape[1]):
                down[order, x] += weight * row[x]


@compiled(inlined=True, inner=True)
def _add_products(products, y, x, lr, dr, er, qr):  # type: ignore[no-untyped-def]
    products[LL, y, x] += lr * lr
    products[LD, y, x] += lr * dr
    products[LE, y, x] += lr * er
    products[LQ, y, x] += lr * qr
    products[DD, y, x] += dr * dr
    products[DE, y, x] += dr * er
    products[DQ, y, x] += dr * qr
    products[EE, y, x] += er * er
    products[EQ, y, x] += er * qr
    products[QQ, y, x] += qr * qr


@compiled(parallel=True)
def fit_rays(sums, nodes, separations, independent, found, portion):  # type: ignore[no-untyped-def]
    """Write found (4, height, width): middle, separation, the nearer layer's share, evidence.

    sums: (nodes, SUMS, height, width) of `window_sums`, in units of the noise. nodes: (nodes,)
    refocused shifts, separations: those that are tried [px per view step], as are middle and
    separation. independent: values of a window with noise of their own. The evidence is a log
    likelihood ratio of two layers to one [nat], less Schwarz' penalty.
    """
    count, _, height, width = sums.shape
    widest = (nodes[1] - nodes[0]) / 2
    for y in rounds(height, portion):
        costs = np.empty(len(separations))
        for x in range(width):
            one, two, node, apart = np.inf, np.inf, 0, 0.0
            for k in range(count):
                ray = sums[k, :, y, x]
                one = min(one, _one_layer(ray, widest, independent))
                room = 2 * min(nodes[k] - nodes[0], nodes[count - 1] - nodes[k]) + widest
                for j in range(len(separations)):
                    costs[j] = (_two_layers(ray, separations[j] / 2, widest, independent)
                                if separations[j] <= room else np.inf)
                best = np.argmin(costs)
                if costs[best] < two:
                    two, node = costs[best], k
                    apart = separations[best] + _vertex(costs, best) * separations[0]
            ray, h = sums[node, :, y, x], apart / 2
            beside = _beside(ray, h, widest)
            found[0, y, x] = nodes[node] + beside
            found[1, y, x] = apart
            found[2, y, x] = (1 + _tilt(ray, h, beside)) / 2
            found[3, y, x] = (one - two) / 2 - np.log(5 * independent)


@compiled(inner=True)
def _vertex(costs, least):  # type: ignore[no-untyped-def]
    """Where between its neighbours a minimum lies, by a parabola; 0 at an end of the tried."""
    if least == 0 or least == len(costs) - 1:
        return 0.0
    before, after = costs[least - 1], costs[least + 1]
    bend = before + after - 2 * costs[least]
    return (before - after) / (2 * bend) if 0 < bend < np.inf else 0.0


@compiled(inner=True)
def _one_layer(ray, widest, independent):  # type: ignore[no-untyped-def]
    """Twice the negative log likelihood of a single layer beside the refocused depth.

    Its noise is that of the frame, or larger where the residuals are.
    """
    beside = min(max(ray[OG] / max(ray[GG], _LEAST), -widest), widest)
    q = beside * beside
    rest = (ray[OO] - 2 * beside * ray[OG] + q * ray[GG]
            + ray[LL] - 2 * q * ray[LD] + q * q * ray[DD])
    noise = max(rest / (5 * independent), 1.0)
    return rest / noise + 5 * independent * np.log(noise)


@compiled(inner=True)
def _two_layers(ray, h, widest, independent):  # type: ignore[no-untyped-def]
    """The same of two layers at h on both sides of a middle near the refocused depth.

    The textures of both layers are assumed independent. Their difference is then as strong as
    their sum, so the first-degree part is h times as strong as the gradient of the sum.
    """
    beside = _beside(ray, h, widest)
    q = h * h - beside * beside
    rest = (ray[LL] - 2 * q * (ray[LD] + q * ray[LQ])
            + q * q * (ray[DD] + 2 * q * ray[DQ] + q * q * ray[QQ])
            - 2 * beside * (ray[LE] - q * (ray[DE] + q * ray[EQ]))
            + beside * beside * ray[EE])
    noise = max(rest / (3 * independent), 1.0)
    tilt = _tilt(ray, h, beside)
    off = beside + tilt * h
    odd = ray[OO] - 2 * off * ray[OG] + off * off * ray[GG]
    power = noise + h * h * (1 - tilt * tilt) * ray[GG] / independent
    return (rest / noise + odd / power
            + independent * (4 * np.log(noise) + np.log(power) + 1))


@compiled(inner=True)
def _beside(ray, h, widest):  # type: ignore[no-untyped-def]
    """How far from the refocused depth the middle of two layers is, by least squares on L."""
    beside = 0.0
    for _ in range(3):
        q = h * h - beside * beside
        least = (ray[LE] - q * (ray[DE] + q * ray[EQ])) / max(ray[EE], _LEAST)
        beside = min(max(least, -widest), widest)
    return beside


@compiled(inner=True)
def _tilt(ray, h, beside):  # type: ignore[no-untyped-def]
    """How much more of the contrast the nearer layer gives, -1 to 1."""
    return min(max((ray[OG] - beside * ray[GG]) / max(h * ray[GG], _LEAST), -1.0), 1.0)
