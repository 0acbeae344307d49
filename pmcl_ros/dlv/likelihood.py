"""From cost to likelihood, and its truncation to a few maxima (paper, section V.A)."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.kernels import compiled, rounds

_NOTHING = np.float32(1e-30)  # a sum of costs this small has no reciprocal


def log_likelihood(cost: NDArray[np.float32]) -> NDArray[np.float32]:
    """L(x, l) = log((max_l C - C(x, l)) / sum_l C + 1), (height, width, labels) float32.

    cost: (labels, height, width) float32, not negative. The worst label of a pixel gets 0; so does
    every label of a pixel that has no cost at all.
    """
    labels, height, width = cost.shape
    likelihood = np.empty((height, width, labels), np.float32)
    _log_likelihood(cost, likelihood)
    return likelihood


def truncate(likelihood: NDArray[np.float32], maxima: int, neighbours: int) -> NDArray[np.float32]:
    """Keep the `maxima` highest local maxima of each pixel (N_lm), set the rest to 0.

    likelihood: (height, width, labels) float32. `neighbours` labels each side of a maximum are
    kept with it (K_lm). The first and the last label may be maxima; equal neighbours are one, in
    their middle; of equally high maxima the one at the lower label is kept first.
    """
    kept = np.zeros_like(likelihood)
    _truncate(likelihood, maxima, neighbours, kept)
    return kept


@compiled(inner=True)
def _log1p(x):  # type: ignore[no-untyped-def]
    """log(1 + x) for x in [0, 1], 2 artanh(x / (2 + x)): a library's would not run on vectors."""
    s = np.divide(x, np.float32(2) + x)  # the operator's check for 0 keeps loops from vectors
    q = s * s
    series = np.float32(1 / 13)
    for n in (11, 9, 7, 5, 3, 1):
        series = series * q + np.float32(1 / n)
    return (s + s) * series


@compiled(parallel=True)
def _log_likelihood(cost, likelihood, portion):  # type: ignore[no-untyped-def]
    for y in rounds(cost.shape[1], portion):
        row_likelihood(cost[:, y], np.zeros(cost.shape[2], np.float32), likelihood[y])


@compiled(inner=True)
def row_likelihood(differences, base, likelihood):  # type: ignore[no-untyped-def]
    """A row of pixels, (width, labels), whose costs are `differences` (labels, width) more than
    `base` (width,), which need not be rounded together with them."""
    labels, width = differences.shape
    most = differences[0].copy()
    total = np.zeros(width, np.float32)
    for row in differences:
        for x in range(width):
            most[x] = row[x] if row[x] > most[x] else most[x]
            total[x] += row[x]
    count = np.float32(labels)
    for x in range(width):
        total[x] += count * base[x]
        total[x] = (np.divide(np.float32(1), total[x]) if total[x] > _NOTHING
                    else np.float32(0))
    rows = np.empty((labels, width), np.float32)
    for label in range(labels):
        row, out = differences[label], rows[label]
        for x in range(width):
            out[x] = _log1p((most[x] - row[x]) * total[x])
    for x in range(width):
        for label in range(labels):
            likelihood[x, label] = rows[label, x]


@compiled(parallel=True)
def _truncate(likelihood, maxima, neighbours, kept, portion):  # type: ignore[no-untyped-def]
    height, width, labels = likelihood.shape
    for y in rounds(height, portion):
        ends = np.empty((labels, 2), np.int64)
        heights = np.empty(labels, np.float32)
        for x in range(width):
            ray = likelihood[y, x]
            count = peaks(ray, ends, heights)
            for _ in range(min(maxima, count)):
                best = np.argmax(heights[:count])
                heights[best] = -1
                middle = (ends[best, 0] + ends[best, 1]) // 2
                first, end = max(middle - neighbours, 0), min(middle + neighbours + 1, labels)
                for label in range(first, end):
                    kept[y, x, label] = ray[label]


@compiled(inner=True)
def peaks(ray, ends, heights):  # type: ignore[no-untyped-def]
    """Write down the local maxima above 0, and the first and last label of each; returns how many
    there are."""
    labels, count, first = len(ray), 0, 0
    while first < labels:
        last = first
        while last + 1 < labels and ray[last + 1] == ray[first]:
            last += 1
        rises = first == 0 or ray[first - 1] < ray[first]
        falls = last == labels - 1 or ray[last + 1] < ray[last]
        if rises and falls and ray[first] > 0:
            ends[count, 0], ends[count, 1], heights[count] = first, last, ray[first]
            count += 1
        first = last + 1
    return count
