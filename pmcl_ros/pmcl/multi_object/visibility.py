"""What is left of an object's evidence when others are there too.

A contour behind another object may be seen through it, or not: nobody knows of what that is made.
And one edge in the image speaks for one of the objects whose contours lie there, not for both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.tracking.observation import Observation

_THROUGH = 0.5  # the chance that what is behind something is seen through it
_BEHIND = 0.005  # m: nearer than this to a surface is not behind it
_SAME_EDGE, _PARALLEL = 2.0, 0.7  # px apart, cosine of the normals: the same edge in the image


@dataclass(frozen=True)
class Sight:
    """value: the evidence that is left of a contour's [nat]. weights: (m,) of its points, 0 to 1.

    share: of the contour's length that counts.
    """

    value: float
    weights: NDArray[np.float64]
    share: float


def sight(points: ContourPoints, others: Sequence[Observation], scale: float) -> Sight:
    """The evidence of a contour where others are too.

    scale: of the evidence, that makes it a log likelihood.

    Explaining away: where a nearer contour of one of the others lies along the same edge, this
    one's evidence is only what it has more. Occlusion: what lies behind another is seen through
    it, all of it, or not, and then says nothing: its log likelihood is log(p exp(E) + 1 - p).
    (Were each stretch of it seen or not for itself, noise would find enough that looks seen.)
    """
    evidence = points.evidence.copy()
    for other in others:
        evidence = _not_explained(points, evidence, other.points)
    weights = np.divide(evidence, points.evidence, out=np.ones(len(evidence)),
                        where=points.evidence > 0)
    each = scale * points.lengths * evidence
    front = _in_front(points, others)
    hidden = front >= 0
    seen = np.bincount(front[hidden], each[hidden], len(others))
    mixed = np.logaddexp(np.log(_THROUGH) + seen, np.log(1 - _THROUGH))
    weights[hidden] *= np.exp(np.log(_THROUGH) + seen - mixed)[front[hidden]]
    length = float(points.lengths.sum())
    return Sight(float(each[~hidden].sum() + mixed[np.unique(front[hidden])].sum()) / scale,
                 weights, float(points.lengths @ weights) / length if length > 0 else 0.0)


def _in_front(points: ContourPoints, others: Sequence[Observation]) -> NDArray[np.int64]:
    """(m,) which of the others points of a contour lie behind, the nearest; -1: of none."""
    nearest, which = np.full(len(points.depths), np.inf), np.full(len(points.depths), -1)
    for number, other in enumerate(others):
        height, width = other.depth.shape
        column, row = np.rint(points.pixels.T).astype(int)
        front = other.depth[row.clip(0, height - 1), column.clip(0, width - 1)]
        first = (front > 0) & (points.depths > front + _BEHIND) & (front < nearest)
        nearest, which = np.where(first, front, nearest), np.where(first, number, which)
    return which


def _not_explained(points: ContourPoints, evidence: NDArray[np.float64], other: ContourPoints
                   ) -> NDArray[np.float64]:
    """(m,) the evidence of points less what a nearer contour along the same edge accounts for."""
    if not len(other.pixels) or not len(points.pixels):
        return evidence
    away, nearest = cKDTree(other.pixels).query(points.pixels, distance_upper_bound=_SAME_EDGE)
    same = np.isfinite(away)
    nearest = np.where(same, nearest, 0)
    # Edges have no sign: the other may lie on the other side.
    same &= np.abs((points.normals * other.normals[nearest]).sum(axis=1)) > _PARALLEL
    same &= (points.depths > other.depths[nearest]) & (evidence > 0)
    rest = np.maximum(evidence - np.maximum(other.evidence[nearest], 0), 0)
    return np.where(same, rest, evidence)
