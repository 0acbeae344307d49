"""The edge energy across a contour, at any distance from it."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.volume import EdgeVolume
from pmcl_ros.kernels import compiled


def energies_across(edges: EdgeVolume, pixels: NDArray[np.floating],
                    normals: NDArray[np.floating], depths: NDArray[np.floating],
                    offsets: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n, k) e(u + offsets[k] n): edge energy across the normal [1], linear between samples.

    pixels: (n, 2) points u, x and y [image px]. normals: (n, 2) unit vectors n. depths: (n,) [m].
    Outside the volume its border goes on.
    """
    inverse = 1 / edges.depths
    labels = (1 / depths - inverse[0]) / (inverse[1] - inverse[0])
    energies = np.empty((len(pixels), len(offsets)))
    _sample(edges.tensor, np.asarray(pixels, np.float64), np.asarray(normals, np.float64), labels,
            np.asarray(offsets, np.float64), energies)
    return energies


@compiled()
def _sample(tensor, pixels, normals, labels, offsets, out):  # type: ignore[no-untyped-def]
    height, width, count, _ = tensor.shape
    for n in range(len(pixels)):
        nx, ny = normals[n]
        label = min(max(labels[n], 0.0), count - 1.0)
        level = min(int(label), count - 2)
        c = label - level
        for k in range(len(offsets)):
            x = min(max(pixels[n, 0] + offsets[k] * nx, 0.0), width - 1.0)
            y = min(max(pixels[n, 1] + offsets[k] * ny, 0.0), height - 1.0)
            i, j = min(int(y), height - 2), min(int(x), width - 2)
            a, b = y - i, x - j
            square = 0.0
            for di, wi in ((0, 1 - a), (1, a)):
                for dj, wj in ((0, 1 - b), (1, b)):
                    for dl, wl in ((0, 1 - c), (1, c)):
                        m = tensor[i + di, j + dj, level + dl]
                        square += wi * wj * wl * (m[0] * nx * nx + m[1] * ny * ny
                                                  + 2 * m[2] * nx * ny)
            out[n, k] = np.sqrt(max(square, 0.0))
