"""What an object at one pose shows of itself."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.render.contour_points import ContourPoints

_NOTHING = 1e-3  # a point that counts less is left out


@dataclass(frozen=True)
class Observation:
    """An object at a pose, as the mode default sees it.

    pose: (4, 4), object to camera [m]. points: of its contour, as if it were alone.
    depth: (height, width) float32 of its surface in the image [m], 0 where it is not.
    local: the evidence about the pose, and how sure it is. in_view: share of it in the image.
    """

    pose: NDArray[np.float64]
    points: ContourPoints
    depth: NDArray[np.float32]
    local: LocalModel
    in_view: float

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(6, 6) of the pose [m, rad], the model's error included; no turn about an axis."""
        error = self.local.basis @ self.local.model_error @ self.local.basis.T
        return self.local.covariance + error


def weighted(points: ContourPoints, weights: NDArray[np.float64]) -> ContourPoints:
    """A contour whose points (m,) count by `weights` (m,), 0 to 1; those of about 0 are gone."""
    kept = weights > _NOTHING
    return replace(
        points, pixels=points.pixels[kept], normals=points.normals[kept],
        depths=points.depths[kept], lengths=(points.lengths * weights)[kept],
        energies=points.energies[kept], evidence=points.evidence[kept],
        piece=points.piece[kept], along=points.along[kept])
