"""Edge energies or log odds across a contour point -> log odds that a surface ends there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.learned import LearnedProfile, learned_contour, learned_creases

# Not learned: the best poses among noise have less.
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
    least: mean evidence from which on a contour is more likely there than not [nat / px].
    """

    offsets: NDArray[np.float32]
    knots: NDArray[np.float32]
    tables: NDArray[np.float32]
    bias: float = 0.0
    least: float = 0.0

    def evidence(self, energies: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n,) of points whose edge energies at the offsets are `energies` (n, j) [nat / px].

        For the points of one contour; `ContourEvidence.score` scores poses, by the same formula.
        """
        terms = [np.interp(column, self.knots, table)
                 for column, table in zip(energies.T, self.tables, strict=True)]
        return self.bias + np.sum(terms, axis=0)

    @classmethod
    def contrast(cls) -> 'ContourProfile':
        """Not learned: the energy on the contour minus the energy just outside it.

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

        The tables reward an edge on the contour, some energy beside it, and little 3 to 5 px
        outside. Missing energy is evidence against the contour: a pose must explain the whole
        outline, not only parts of it.
        """
        numbers = learned_contour()
        return cls.from_numbers(numbers, numbers.least_evidence)

    @classmethod
    def learned_creases(cls) -> 'ContourProfile':
        """The log odds of a sharp edge of the mesh inside the outline; the same on both sides."""
        return cls.from_numbers(learned_creases())

    @classmethod
    def from_numbers(cls, numbers: LearnedProfile, least: float = 0.0) -> 'ContourProfile':
        """The profile of a data file. least: as the attribute [nat / px]."""
        return cls(np.array(numbers.offsets, np.float32), np.array(numbers.knots, np.float32),
                   np.array(numbers.tables, np.float32), numbers.bias, least)
