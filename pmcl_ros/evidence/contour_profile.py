"""What the edge energy across a contour says for and against a surface that ends there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# As `pmcl learn` prints it (docs/method.md, "What is learned"): the table, whose rows are offsets,
# and the bias (evaluation/learning.py).
_OFFSETS = (-5, -3, -1.5, 0, 1.5, 3, 5)
_KNOTS = (0, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.5)
_TABLES = (
    (0.13, -0.02, -0.01, -0.01, 0.11, -0.23, -0.26, 0.29),
    (-0.68, 0.27, 0.37, 0.39, 0.22, 0.13, -0.02, -0.69),
    (-0.23, -0.15, 0.17, 0.31, 0.30, 0.29, 0.44, -1.14),
    (-1.55, -1.43, -0.90, -0.70, 0.11, 0.72, 1.23, 2.51),
    (-0.94, -0.24, 0.16, 0.42, 0.54, 0.44, 0.53, -0.91),
    (0.54, 1.05, 0.78, 0.37, -0.39, -0.53, -0.60, -1.21),
    (0.72, -0.02, -0.26, -0.17, -0.16, 0.10, 0.03, -0.23),
)
_BIAS = -1.23
# Of creases, as `pmcl learn --creases` prints it: the offsets on one side, the crease itself last.
_CREASES = (
    (0.57, 0.21, 0.18, -0.01, -0.17, -0.34, -0.41, -0.03),
    (0.34, 0.62, 0.55, -0.21, -0.51, -0.15, 0.07, -0.71),
    (-0.72, -1.30, -0.36, -0.15, 0.45, 1.03, 1.41, -0.37),
    (-0.67, -0.92, -0.34, 0.06, 0.20, 0.41, 0.46, 0.80),
)
_CREASES_BIAS = -0.80
# One in twenty objects found in generated scenes has less (`evaluation.searches.Supports`,
# `pmcl learn`): the best of very many poses among noise has more than none.
_LEAST = 0.33

# A first guess: the best poses among noise have less.
_LEAST_CONTRAST = 0.5


@dataclass(frozen=True)
class ContourProfile:
    """Evidence of one point of the contour: bias + sum over j of T_j(e(u + offsets[j] n)).

    u: the point in the image; n: the unit normal there, out of the object; e: the edge energy
    across the contour at the point's own depth [1].

    offsets: (j,) from the contour, outside positive [image px].
    knots: (k,) edge energies, ascending from 0 [1].
    tables: (j, k) T_j at the knots, linear between them, constant beyond the last [nat / px of
        contour].
    bias: [nat / px of contour].
    least: mean evidence of a contour that is rather there than not [nat / px].
    """

    offsets: NDArray[np.float32]
    knots: NDArray[np.float32]
    tables: NDArray[np.float32]
    bias: float = 0.0
    least: float = 0.0

    def evidence(self, energies: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n,) of points whose edge energies at the offsets are `energies` (n, j) [nat / px]."""
        terms = [np.interp(column, self.knots, table)
                 for column, table in zip(energies.T, self.tables, strict=True)]
        return self.bias + np.sum(terms, axis=0)

    @classmethod
    def contrast(cls) -> 'ContourProfile':
        """Learned from nothing: the energy on the contour less that just outside it.

        Glass shows edges as strong a few pixels inside (the inner wall, caustics), hardly ever
        outside. Both terms saturate at 2, and have the same expectation where there is no object.
        """
        slopes = np.array([1, -1 / 3, -1 / 3, -1 / 3], np.float32)
        knots = np.array([0, 2], np.float32)
        return cls(np.array([0, 3, 4.5, 6], np.float32), knots, slopes[:, None] * knots,
                   least=_LEAST_CONTRAST)

    @classmethod
    def learned(cls) -> 'ContourProfile':
        """The log odds that a surface ends there, learned from generated scenes.

        In words: an edge on the contour, some energy beside it, little 3 to 5 px outside. Where
        nothing is seen that speaks against a contour, so that a large outline has to be found, not
        only some of it.
        """
        return cls(np.array(_OFFSETS, np.float32), np.array(_KNOTS, np.float32),
                   np.array(_TABLES, np.float32), _BIAS, _LEAST)

    @classmethod
    def of_creases(cls) -> 'ContourProfile':
        """The log odds that a sharp edge of the mesh is there, inside the outline; alike on both
        sides.
        """
        tables = np.array(_CREASES + _CREASES[-2::-1], np.float32)
        return cls(np.array(_OFFSETS, np.float32), np.array(_KNOTS, np.float32), tables,
                   _CREASES_BIAS)
