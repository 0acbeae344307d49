"""How likely one and two layers are along each ray, from sums over its window (`layer_sums`)."""

import numpy as np
from numba import prange

from pmcl_ros.dlv.layer_sums import DD, DE, DQ, EE, EQ, GG, LD, LE, LL, LQ, OG, OO, QQ
from pmcl_ros.runtime.kernels import compiled

_LEAST = 1e-9  # so little is no contrast


@compiled(parallel=True)
def fit_rays(sums, nodes, separations, independent, found):  # type: ignore[no-untyped-def]
    """Writes the middle, the separation [px per view step], the nearer share and the evidence."""
    count, _, height, width = sums.shape
    widest = (nodes[1] - nodes[0]) / 2
    for y in prange(height):
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


@compiled()
def _vertex(costs, least):  # type: ignore[no-untyped-def]
    """Where between its neighbours a minimum lies, by a parabola; 0 at an end of the tried."""
    if least == 0 or least == len(costs) - 1:
        return 0.0
    before, after = costs[least - 1], costs[least + 1]
    bend = before + after - 2 * costs[least]
    return (before - after) / (2 * bend) if 0 < bend < np.inf else 0.0


@compiled()
def _one_layer(ray, widest, independent):  # type: ignore[no-untyped-def]
    """Twice the negative log likelihood of a single layer beside the refocused depth.

    Its noise is the frame's or, where that does not explain the rest, as large as the rest says.
    """
    beside = min(max(ray[OG] / max(ray[GG], _LEAST), -widest), widest)
    q = beside * beside
    rest = (ray[OO] - 2 * beside * ray[OG] + q * ray[GG]
            + ray[LL] - 2 * q * ray[LD] + q * q * ray[DD])
    noise = max(rest / (5 * independent), 1.0)
    return rest / noise + 5 * independent * np.log(noise)


@compiled()
def _two_layers(ray, h, widest, independent):  # type: ignore[no-untyped-def]
    """The same of two layers at h on both sides of a middle near the refocused depth.

    Both layers' textures are taken for independent: what the nearer one has more is then as strong
    as their sum, which makes the first-degree part h times as strong as the sum's gradient.
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


@compiled()
def _beside(ray, h, widest):  # type: ignore[no-untyped-def]
    """How far from the refocused depth the middle of two layers is, by least squares on L."""
    beside = 0.0
    for _ in range(3):
        q = h * h - beside * beside
        least = (ray[LE] - q * (ray[DE] + q * ray[EQ])) / max(ray[EE], _LEAST)
        beside = min(max(least, -widest), widest)
    return beside


@compiled()
def _tilt(ray, h, beside):  # type: ignore[no-untyped-def]
    """How much more of the contrast the nearer layer gives, -1 to 1."""
    return min(max((ray[OG] - beside * ray[GG]) / max(h * ray[GG], _LEAST), -1.0), 1.0)
