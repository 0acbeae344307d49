"""How a sheet of paper with a board may be bent: the shapes, and how likely each is."""

import numpy as np
from numpy.typing import NDArray

_DEGREE = 4  # of the polynomial: paper that is curled at one edge, or at a corner
USUAL_BEND = 1e-4  # m, at the border
_FREEDOM = 1.0  # Student's t: a sheet may be bent a lot
_MOVED_DEGREE = 2 * _DEGREE - 1  # of how its points move along it
_GRID = 9  # places on each side where it is kept from stretching
_NO_STRAIN = 1e-9  # of the largest: of a turn of all points, and rounding


class Sheet:
    """A sheet of paper with corners that are flat (m, 3) [m], z = 0, while it is.

    A bend is given by the heights (k,) [m] of its terms. They are polynomials of second degree and
    more, without a plane: that is the pose. Paper does not stretch: where it is steep, its points
    move along it (von Karman 1910: u_x = -z_x^2 / 2, v_y = -z_y^2 / 2, u_y + v_x = -z_x z_y; by
    least squares where the bend is not that of a sheet that can be unrolled).
    terms: (m, k) what each adds to the heights of the corners.
    """

    def __init__(self, flat: NDArray[np.float64]) -> None:
        low, high = flat[:, :2].min(axis=0), flat[:, :2].max(axis=0)
        middle, reach = (low + high) / 2, (high - low).max() / 2
        grid = np.stack(np.meshgrid(*np.linspace(low, high, _GRID).T), axis=-1).reshape(-1, 2)
        corners, places = (flat[:, :2] - middle) / reach, (grid - middle) / reach
        heights, _, _ = _monomials(corners, 2, _DEGREE)
        plane = np.concatenate([np.ones((len(flat), 1)), corners], axis=1)
        planes = np.linalg.lstsq(plane, heights, rcond=None)[0]
        moved, _, _ = _monomials(corners, 1, _MOVED_DEGREE)
        _, by_x, by_y = _monomials(places, 1, _MOVED_DEGREE)
        strains = np.block([[by_x, 0 * by_x], [0 * by_y, by_y], [by_y, by_x]])
        self._flat = flat
        self.terms = heights - plane @ planes
        self._slopes = _monomials(places, 2, _DEGREE)[1:] - planes[1:, None]
        self._moved = np.kron(np.eye(2), moved) @ np.linalg.pinv(strains, _NO_STRAIN) / reach

    def points(self, bend: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, 3) the corners [m]."""
        x, y = self._slopes @ bend
        along = self._moved @ -np.concatenate([x ** 2 / 2, y ** 2 / 2, x * y])
        return self._flat + np.stack([*along.reshape(2, -1), self.terms @ bend], axis=1)

    def derivatives(self, bend: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, 3, k) of the corners by the terms' heights."""
        by_x, by_y = self._slopes
        x, y = (self._slopes @ bend)[..., None]
        along = self._moved @ -np.concatenate([x * by_x, y * by_y, x * by_y + y * by_x])
        return np.stack([*along.reshape(2, *self.terms.shape), self.terms], axis=1)


def bend_cost(bend: NDArray[np.float64], size: float = USUAL_BEND) -> float:
    """Negative logarithm of the prior of terms' heights (k,) [m], without what is constant."""
    return float((_FREEDOM + 1) / 2 * np.log1p(np.square(bend / size) / _FREEDOM).sum())


def bend_information(bend: NDArray[np.float64], size: float = USUAL_BEND) -> NDArray[np.float64]:
    """(k,) inverse variances [1/m^2] of Gaussians about 0 in place of the prior, for a step."""
    return np.asarray((_FREEDOM + 1) / (_FREEDOM + np.square(bend / size)) / size ** 2)


def _monomials(places: NDArray[np.float64], lowest: int, highest: int) -> NDArray[np.float64]:
    """(3, m, k) the monomials of these degrees at places (m, 2), and their slopes by x, by y."""
    powers = np.array([(degree - power, power) for degree in range(lowest, highest + 1)
                       for power in range(degree + 1)])
    x, y = places.T[..., None] ** powers.T[:, None]
    by_x, by_y = powers.T[:, None] * places.T[..., None] ** np.maximum(powers.T[:, None] - 1, 0)
    return np.stack([x * y, by_x * y, x * by_y])
