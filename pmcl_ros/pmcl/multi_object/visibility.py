"""The evidence of an object beside others: occlusion, shared edges, residual edges.

A contour behind another object may be visible through it or not, as the material is unknown. An
edge in the image counts for one of the objects whose contours lie there, not for both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.local_model import Observation
from pmcl_ros.pmcl.render.contour_points import ContourPoints

_TRANSPARENT = 0.5  # prior probability that a contour is visible through an object before it
_BEHIND = 0.005  # m: least distance behind a surface
_SAME_EDGE, _PARALLEL = 2.0, 0.7  # px apart, cosine of the normals: the same edge in the image
_SUPPRESSED = 2.5  # px: standard deviation of the band about a contour without residual edges


@dataclass(frozen=True)
class VisibleEvidence:
    """The evidence of a contour beside other objects.

    value: sum over the contour [nat]. weights: (m,) of its points, 0 to 1. share: of the length
    of the contour that counts.
    """

    value: float
    weights: NDArray[np.float64]
    share: float


def visible_evidence(points: ContourPoints, others: Sequence[Observation], scale: float
                     ) -> VisibleEvidence:
    """The evidence of a contour beside other objects.

    scale: factor from evidence to log likelihood.

    Explaining away: where a nearer contour of another object lies along the same edge, only the
    excess over that contour's evidence counts. Occlusion: the part behind another object is
    visible through it as a whole with probability p, else it has no evidence; its log likelihood
    is log(p exp(E) + 1 - p). (Separate decisions for each stretch would add up noise.)
    """
    evidence = points.evidence.copy()
    for other in others:
        evidence = _not_explained(points, evidence, other.points)
    weights = np.divide(evidence, points.evidence, out=np.ones(len(evidence)),
                        where=points.evidence > 0)
    terms = scale * points.lengths * evidence
    front = _in_front(points, others)
    hidden = front >= 0
    seen = np.bincount(front[hidden], terms[hidden], len(others))
    mixed = np.logaddexp(np.log(_TRANSPARENT) + seen, np.log(1 - _TRANSPARENT))
    weights[hidden] *= np.exp(np.log(_TRANSPARENT) + seen - mixed)[front[hidden]]
    length = float(points.lengths.sum())
    value = float(terms[~hidden].sum() + mixed[np.unique(front[hidden])].sum()) / scale
    return VisibleEvidence(value, weights,
                           float(points.lengths @ weights) / length if length > 0 else 0.0)


def _in_front(points: ContourPoints, others: Sequence[Observation]) -> NDArray[np.int64]:
    """(m,) index of the nearest other object that lies before each point; -1: none."""
    nearest, which = np.full(len(points.depths), np.inf), np.full(len(points.depths), -1)
    for number, other in enumerate(others):
        front = depth_before(points, other.depth)
        first = front < nearest
        nearest, which = np.where(first, front, nearest), np.where(first, number, which)
    return which


def depth_before(points: ContourPoints, surface: NDArray[np.float32]) -> NDArray[np.float64]:
    """(m,) depth at which a surface lies before each point [m]; infinite where it does not.

    surface: (height, width) its depth in the picture, 0 where there is none [m].
    """
    height, width = surface.shape
    column, row = np.rint(points.pixels.T).astype(int)
    depth = surface[row.clip(0, height - 1), column.clip(0, width - 1)].astype(np.float64)
    return np.where((depth > 0) & (points.depths > depth + _BEHIND), depth, np.inf)


def _not_explained(points: ContourPoints, evidence: NDArray[np.float64], other: ContourPoints
                   ) -> NDArray[np.float64]:
    """(m,) the evidence, less that of a nearer contour along the same edge."""
    if not len(other.pixels) or not len(points.pixels):
        return evidence
    away, nearest = cKDTree(other.pixels).query(points.pixels, distance_upper_bound=_SAME_EDGE)
    same = np.isfinite(away)
    nearest = np.where(same, nearest, 0)
    # Edges have no sign: normals may be opposite.
    same &= np.abs((points.normals * other.normals[nearest]).sum(axis=1)) > _PARALLEL
    same &= (points.depths > other.depths[nearest]) & (evidence > 0)
    rest = np.maximum(evidence - np.maximum(other.evidence[nearest], 0), 0)
    return np.where(same, rest, evidence)


def residual_edges(edges: EvidenceVolume, contours: Sequence[ContourPoints]) -> EvidenceVolume:
    """The evidence without that of edges along contours, at all depths.

    An edge has energy at most labels, as the views differ only in the place of the edge.
    """
    height, width = edges.tensor.shape[:2]
    off = np.ones((height, width), bool)
    for each in contours:
        column, row = np.rint(each.pixels.T).astype(int)
        off[row.clip(0, height - 1), column.clip(0, width - 1)] = False
    away: NDArray[np.float64] = distance_transform_edt(off) if not off.all() else np.full(
        off.shape, np.inf)
    kept = (1 - np.exp(-0.5 * (away / _SUPPRESSED) ** 2)).astype(np.float32)
    return edges.suppressed(kept)
