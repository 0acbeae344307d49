"""Local polynomials through the views: the change of each pixel with the place of the view.

Refocused at a depth, a surface there looks the same in all views. A surface d px per view step off
moves by d times the place of the view: its derivatives along places are powers of d times those
along the picture. The polynomials are of second degree, least squares through all views.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import VolumeError
from pmcl_ros.runtime.kernels import compiled, rounds

CONSTANT, FIRST, SECOND, REST = slice(0, 1), slice(1, 3), slice(3, 6), slice(6, 8)
TAPS = 6  # pixels along an axis that a sample is made from: a polynomial of the fifth degree
_DEGREES = 5, 4, 3, 2  # what is left over polynomials of such degree is taken for noise


@dataclass(frozen=True)
class ViewMoments:
    """Weights of the views that give a pixel's polynomial, 1, a, b, a^2, a b, b^2, and its noise.

    places: (views, 2) where each view's light entered, a and b, in steps along x.
    weights: (8, views) float64: six coefficients, then two sums in which no polynomial is left of
        the fifth degree (or the highest that few views allow), of unit variance where that of a
        view of full light is 1.
    covariance: (6, 6) of the coefficients, for such noise.
    """

    places: NDArray[np.float64]
    weights: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @classmethod
    def from_places(cls, places: NDArray[np.float64], light: NDArray[np.float64]) -> 'ViewMoments':
        """light: (views,) of each view; one of light w has noise of variance 1 / w.

        Raises VolumeError when the places are too few, or on a line.
        """
        basis = _powers(places, 2)
        if np.linalg.matrix_rank(basis) < basis.shape[1] or len(places) < 8:
            raise VolumeError(f'{len(places)} views cannot tell two layers along a ray: 3x3 or '
                              'more are needed; choose more views, or layers volume')
        covariance = np.linalg.inv(basis.T @ (light[:, None] * basis))
        coefficients = covariance @ (basis.T * light)
        rest = next(rest for degree in _DEGREES
                    if len(rest := _left_over(places, light, degree)) == 2)
        return cls(places, np.concatenate([coefficients, rest * np.sqrt(light)]), covariance)

    def fourth(self) -> NDArray[np.float64]:
        """(3, 5) of a surface d beside, what its fourth derivatives add to the second-degree
        coefficients, times d^4: those along xxxx, xxxy, xxyy, xyyy, yyyy.
        """
        a, b = self.places.T
        many = np.array([1, 4, 6, 4, 1])
        powers = np.stack([a ** (4 - k) * b ** k for k in range(5)], axis=1)
        return np.asarray(self.weights[SECOND] @ powers * many / 24)


def _left_over(places: NDArray[np.float64], light: NDArray[np.float64], degree: int
               ) -> NDArray[np.float64]:
    """(2 or less, views) orthonormal, and orthogonal to all polynomials up to a degree."""
    basis = _powers(places, degree) * np.sqrt(light)[:, None]
    vectors, values, _ = np.linalg.svd(basis)
    rank = int((values > 1e-6 * values[0]).sum())
    return vectors[:, rank:].T[-2:]


def _powers(places: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    a, b = places.T
    return np.stack([a ** (total - k) * b ** k for total in range(degree + 1)
                     for k in range(total + 1)], axis=1)


def refocused_moments(planes: NDArray[np.float32], pad: int, shifts: NDArray[np.float64],
                      weights: NDArray[np.float64], rows: range, columns: range
                      ) -> NDArray[np.float32]:
    """(moments, 3, rows, columns) sums of the views, each displaced by its shift.

    planes: (views, 3, height + 2 pad, width + 2 pad). shifts: (views, 2) [px]. weights: (moments,
    views).
    """
    out = np.empty((len(weights), 3, len(rows), len(columns)), np.float32)
    cells = np.floor(shifts).astype(np.int64)
    taps = _lagrange(shifts - cells).astype(np.float32)
    corner = cells - (TAPS // 2 - 1) + pad + [columns.start, rows.start]
    _sum(planes, corner, taps, weights.astype(np.float32), out)
    return out


def _lagrange(fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., TAPS) weights of the pixels from -2 to 3 for a place `fraction` px from pixel 0."""
    nodes = np.arange(1 - TAPS // 2, TAPS // 2 + 1)
    gaps = nodes[:, None] - nodes + np.eye(TAPS)
    parts = np.where(np.eye(TAPS, dtype=bool), 1, (fraction[..., None, None] - nodes) / gaps)
    return np.asarray(parts.prod(axis=-1))


@compiled(parallel=True)
def _sum(planes, corner, taps, weights, out, portion):  # type: ignore[no-untyped-def]
    moments, channels, height, width = out.shape
    reach = taps.shape[2]
    for y in rounds(height, portion):
        out[:, :, y] = 0
        between = np.empty(width + reach, np.float32)
        sample = np.empty(width, np.float32)
        for view in range(len(planes)):
            x, top = corner[view, 0], corner[view, 1] + y
            for channel in range(channels):
                between[:] = 0
                for k in range(reach):
                    row = planes[view, channel, top + k, x:x + width + reach]
                    tap = taps[view, 1, k]
                    for i in range(width + reach):
                        between[i] += tap * row[i]
                sample[:] = 0
                for k in range(reach):
                    tap, shifted = taps[view, 0, k], between[k:k + width]
                    for i in range(width):
                        sample[i] += tap * shifted[i]
                for moment in range(moments):
                    weight, total = weights[moment, view], out[moment, channel, y]
                    for i in range(width):
                        total[i] += weight * sample[i]
