"""Contour -> support (evidence along its weakest part), evidence beyond it, share in view."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.spatial import KDTree

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.energies import evidence_across
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.contour_points import ContourPoints

_ARC = 20.0  # px: length of an arc with one mean; contributions farther apart share no noise
_PART = 0.2  # of a contour: its weakest part
_BEYOND = np.arange(4.0, 16.0)  # px outwards: where the contour of a larger object may be
_HALF = 0.0025  # share of the posterior: half of one in 200 particles, whatever their number
_OWN = 3.0  # px: a place as near to the contour as this is a part of it


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


def evidence_beyond(points: ContourPoints, volume: EvidenceVolume, profile: ContourProfile,
                    others: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
    """(m,) the largest evidence for another contour beyond each point of a contour [nat / px].

    It is that for a contour with the same normal, 4 to 15 px outwards; 0 where there is none for
    one, where the object itself is beyond the point, or out of the image. The contour of a wrong
    object often lies inside of that of the object that is there, which then shows beyond it.
    others: (height, width) pixels of objects that are known to be there, which show nothing else.
    """
    if not len(points.lengths):
        return np.zeros(0)
    evidence = evidence_across(volume, points.pixels, points.normals, points.depths, profile,
                               _BEYOND)
    evidence = np.maximum(evidence, 0) * points.outer[:, None]
    point, place = np.nonzero(evidence)
    there = points.pixels[point] + _BEYOND[place, None] * points.normals[point]
    explained = KDTree(points.pixels).query(there, distance_upper_bound=_OWN)[0] < _OWN
    column, row = np.rint(there).astype(int).T
    height, width = volume.tensor.shape[:2]
    explained |= (column < 0) | (row < 0) | (column >= width) | (row >= height)
    if others is not None:
        around = maximum_filter(others, 1 + 2 * round(_OWN))
        explained |= around[row.clip(0, height - 1), column.clip(0, width - 1)]
    evidence[point[explained], place[explained]] = 0
    return np.asarray(evidence.max(axis=1))


def log_odds(weight: float) -> float:
    """Log odds of the posterior weight of a mode, 0 to 1 [nat].

    The weight is a share of a sample: of one that holds all of some 200 particles, half a particle
    more may be elsewhere.
    """
    return math.log((weight + _HALF) / (1 - weight + _HALF))


def share_in_view(model: ObjectModel, pose: NDArray[np.float64], pinhole: Pinhole) -> float:
    """Share of a mesh's vertices that lie in the image, 0 to 1.

    Parts out of view are neither evidence for a pose nor against it. But a small part in view must
    not suffice to accept an object.
    """
    pixels = pinhole.project(model.vertices @ pose[:3, :3].T + pose[:3, 3])
    inside = (pixels > -0.5) & (pixels < np.array([pinhole.width, pinhole.height]) - 0.5)
    return float(inside.all(axis=1).mean())
