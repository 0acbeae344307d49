"""Evidence along the weakest part of a contour: it separates the object from others."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.contour_points import ContourPoints

_ARC = 20.0  # px: length of an arc with one mean; contributions farther apart share no noise
_PART = 0.2  # of a contour: its weakest part


def contour_support(points: ContourPoints, seen: float) -> float:
    """Mean evidence along the weakest fifth of a contour, minus a penalty [nat / px].

    points: of the contour in the image. seen: share of the object in view. Each pixel out of view
    costs one nat, shared by those in view. Minus infinity where there is no contour.

    The contour of a wrong object can fit most of an outline better than the right one, so the mean
    over all of it separates them badly. But a wrong contour leaves stretches without any edge.
    """
    if not len(points.lengths) or seen <= 0:
        return -np.inf
    arcs = np.stack([points.piece, (points.along / _ARC).astype(np.int64)], axis=1)
    number = np.unique(arcs, axis=0, return_inverse=True)[1].ravel()
    lengths = np.bincount(number, points.lengths)
    evidence = np.bincount(number, points.lengths * points.evidence) / lengths
    order = np.argsort(evidence, kind='stable')
    lengths, evidence = lengths[order] / lengths.sum(), evidence[order]
    weakest = np.clip(_PART - (np.cumsum(lengths) - lengths), 0, lengths)
    return float(weakest @ evidence / weakest.sum() - (1 - seen) / seen)


def share_in_view(model: ObjectModel, pose: NDArray[np.float64], pinhole: Pinhole) -> float:
    """Share of a mesh's vertices that lie in the image, 0 to 1.

    Parts out of view are neither evidence for a pose nor against it. But a small part in view must
    not suffice to accept an object.
    """
    pixels = pinhole.project(model.vertices @ pose[:3, :3].T + pose[:3, 3])
    inside = (pixels > -0.5) & (pixels < np.array([pinhole.width, pinhole.height]) - 0.5)
    return float(inside.all(axis=1).mean())
