"""Covariance of the displacement between the contour in the image and the rendered one."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.learned import learned_contour

# Cosine of normals: points of one side of a contour. The other side looks at other things.
FACING = 0.5
# rad: between two views, by which the correlation of their displacements falls to 1 / e. Chosen,
# not learned: over 10 degrees a refracted wall or a rim changes what it shows.
_ANGLE = 0.2


@dataclass(frozen=True)
class ModelError:
    """Displacement of the seen contour along its normals: a Gaussian field over the contour [px].

    Refraction moves a glass contour inwards, the blur of a film moves it outwards, and the camera
    model and the mesh have errors. One part is common to the whole outline, one is local. The
    evidence along the contour cannot reveal either.

    common: standard deviation of the displacement of the whole contour [px].
    local: standard deviation of the local displacement [px]. length: its correlation length [px].
    degrees_of_freedom: of the Student's t of the errors of poses (`student_t`).
    """

    common: float
    local: float
    length: float
    degrees_of_freedom: float = math.inf

    @classmethod
    def learned(cls) -> 'ModelError':
        """The error that was learned from generated scenes."""
        numbers = learned_contour()
        return cls(numbers.common_error, numbers.local_error, numbers.error_length)

    def covariance(self, distance: NDArray[np.float64], same_side: NDArray[np.bool_]
                   ) -> NDArray[np.float64]:
        """(n, n) [px^2] between points of a contour.

        distance: (n, n) between them in the image [px]. same_side: (n, n) whether their normals
        point the same way.
        """
        near = np.where(same_side, np.exp(-distance / self.length), 0)
        return self.common ** 2 + self.local ** 2 * near

    @staticmethod
    def between_views(angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, m) correlation of the displacements in views at `angles` (n, m) [rad]."""
        return np.asarray(np.exp(-angles / _ANGLE))
