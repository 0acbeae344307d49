"""How far a contour lies from where the model says, which no evidence along it can tell."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.learned import learned_contour

# Cosine of normals: points of one side of a contour. The other side looks at other things.
FACING = 0.5


@dataclass(frozen=True)
class ModelError:
    """Displacement of the seen contour along its normals: a Gaussian field over the contour [px].

    Refraction moves a glass contour inwards, a film's blur moves it outwards, the camera's model
    and the mesh have their errors: of the whole outline alike, and of each stretch of it.

    common: standard deviation of what the whole contour has in common [px].
    local: of what stretches of it have for themselves [px]. length: of these stretches [px].
    """

    common: float
    local: float
    length: float

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
