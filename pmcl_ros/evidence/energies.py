"""EvidenceVolume, contour points -> edge energy or log odds, and evidence, along their normals."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.runtime.kernels import compiled


def energies_across(volume: EvidenceVolume, pixels: NDArray[np.floating],
                    normals: NDArray[np.floating], depths: NDArray[np.floating],
                    offsets: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n, k) e(u + offsets[k] n): the tensor's reading across the normal, linear between samples.

    It is the edge energy [1], or the log odds of a `ContourMap` [nat / px].

    pixels: (n, 2) points u, x and y [image px]. normals: (n, 2) unit vectors n. depths: (n,) [m].
    Outside the volume its border is repeated.
    """
    energies = np.empty((len(pixels), len(offsets)))
    _sample(volume.tensor, *_double(pixels, normals, volume.labels(depths), offsets), energies)
    return energies


def evidence_across(volume: EvidenceVolume, pixels: NDArray[np.floating],
                    normals: NDArray[np.floating], depths: NDArray[np.floating],
                    profile: ContourProfile, shifts: NDArray[np.floating]
                    ) -> NDArray[np.float64]:
    """(n, k) evidence of contour points moved along their normals by `shifts` (k,) [nat / px].

    As `energies_across`; shifts: outwards [image px], the points' depths stay.
    """
    offsets = np.add.outer(np.asarray(shifts, np.float64), profile.offsets).ravel()
    energies = energies_across(volume, pixels, normals, depths, offsets)
    evidence = np.empty((len(pixels), len(shifts)))
    slopes = np.diff(profile.tables) / np.diff(profile.knots)
    _judge(energies, *_double(profile.knots, slopes), profile.bias + profile.tables[:, 0].sum(),
           evidence)
    return evidence


def region_across(volume: EvidenceVolume, pixels: NDArray[np.floating],
                  normals: NDArray[np.floating], depths: NDArray[np.floating],
                  shifts: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n, k) evidence that a silhouette gains or loses with the pixels it covers [nat / px].

    It is the integral of `volume.region` along the normals from 0 to each of `shifts` (k,)
    [image px], ascending, 0 among them. The rest as in `evidence_across`.
    """
    region = volume.region
    if not region.size:
        return np.zeros((len(pixels), len(shifts)))
    places = np.rint(pixels[:, None] + shifts[:, None] * normals[:, None]).astype(int)
    column, row = places[..., 0], places[..., 1]
    height, width, labels = region.shape
    seen = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    label = np.rint(volume.labels(depths)).astype(int).clip(0, labels - 1)
    values = np.where(seen, region[row.clip(0, height - 1), column.clip(0, width - 1),
                                   label[:, None]], 0)
    parts = np.diff(shifts) * (values[:, 1:] + values[:, :-1]) / 2  # by the trapezoidal rule
    sums = np.pad(np.cumsum(parts, axis=1), ((0, 0), (1, 0)))
    return np.asarray(sums - sums[:, [int(np.abs(shifts).argmin())]])


def _double(*arrays: NDArray[np.floating]) -> list[NDArray[np.float64]]:
    """As float64, so that each kernel is compiled for one type."""
    return [np.ascontiguousarray(each, np.float64) for each in arrays]


@compiled()
def _judge(energies, knots, slopes, bias, out):  # type: ignore[no-untyped-def]
    """The profile's evidence of energies (n, k * j): its ramps, from knot to knot."""
    offsets = len(slopes)
    for n in range(len(out)):
        for k in range(out.shape[1]):
            total = bias
            for j in range(offsets):
                e = energies[n, k * offsets + j]
                for i in range(len(knots) - 1):
                    total += slopes[j, i] * min(max(e - knots[i], 0.0), knots[i + 1] - knots[i])
            out[n, k] = total


@compiled()
def _sample(tensor, pixels, normals, labels, offsets, out):  # type: ignore[no-untyped-def]
    height, width, count, _ = tensor.shape
    is_map = tensor.shape[3] == 5
    for n in range(len(pixels)):
        nx, ny = normals[n]
        xx, yy, xy = nx * nx, ny * ny, 2 * nx * ny
        label = min(max(labels[n], 0.0), count - 1.0)
        level = max(min(int(label), count - 2), 0)
        next_level = min(level + 1, count - 1)
        c = label - level
        for k in range(len(offsets)):
            x = min(max(pixels[n, 0] + offsets[k] * nx, 0.0), width - 1.0)
            y = min(max(pixels[n, 1] + offsets[k] * ny, 0.0), height - 1.0)
            i, j = min(int(y), height - 2), min(int(x), width - 2)
            a, b = y - i, x - j
            value = 0.0
            for di, wi in ((0, 1 - a), (1, a)):
                for dj, wj in ((0, 1 - b), (1, b)):
                    ray = tensor[i + di, j + dj]
                    for dl, wl in ((level, 1 - c), (next_level, c)):
                        if is_map:
                            value += wi * wj * wl * (
                                ray[dl, 0] + ray[dl, 1] * nx + ray[dl, 2] * ny
                                + ray[dl, 3] * (xx - yy) + ray[dl, 4] * xy)
                        else:
                            value += wi * wj * wl * (ray[dl, 0] * xx + ray[dl, 1] * yy
                                                      + ray[dl, 2] * xy)
            out[n, k] = value if is_map else np.sqrt(max(value, 0.0))
