"""Searches other evidence of a capture where edges lose the object or are unsure of it."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.edges import EdgeVolume, MakeEvidence
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.history import Generation, Watch
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.search import Stages
from pmcl_ros.runtime.errors import error_line, is_foreseen

_LOG = logging.getLogger(__name__)
_Search = Callable[[EvidenceVolume, Watch | None], PoseEstimate]


class Evaluator(Protocol):
    """What tells the evidence of poses: a `Localizer`."""

    def contour(self, volume: EvidenceVolume, pose: NDArray[np.float64]) -> ContourPoints:
        """The contour of a pose (4, 4) and its evidence."""
        ...

    def evidence(self, volume: EvidenceVolume, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) evidence of poses (n, 4, 4) [nat]."""
        ...


def is_needed(found: PoseEstimate) -> bool:
    """Whether edges lose the object or are unsure of it.

    Unsure: the weakest part of the contour is more likely absent than present.
    """
    return found.lost or found.support < 0


def second_search(found: PoseEstimate, edges: EdgeVolume, make: MakeEvidence, evaluator: Evaluator,
                  search: _Search, stages: Stages, watch: Watch | None) -> PoseEstimate:
    """What other evidence finds, where that `is_needed`.

    What edges are unsure of stays where the other evidence shows it too. Where both lose the
    object, the better pose is told: that with the more evidence by both together.
    make: the other evidence; where that is impossible, or the search is stopped, what was found
    stays. search: in it, watched. watch: gets the generations of a search that counts.
    """
    capture = f'capture {edges.header.stamp_ns}'
    edges_do = 'lose the object' if found.lost else 'are unsure of the object'
    seen: list[Generation] = []
    try:
        other = make()
        if other is None:
            _LOG.info('%s: edges %s, and no other evidence came', capture, edges_do)
            return found
        if not found.lost and _shows(evaluator, other, found.pose):
            return found
        again = search(other, None if watch is None else seen.append)
        if not stages.go_on(1.0):
            return found
        better = (not (found.lost and again.lost)
                  or _has_more(again, found, evaluator, (edges, other)))
    except Exception as error:
        if not is_foreseen(error):
            raise
        _LOG.warning('%s: edges %s, and the search in other evidence failed: %s', capture,
                     edges_do, error_line(error))
        return found
    _LOG.info('%s: edges %s; the %s %s', capture, edges_do, other.kind,
              'does not find it' if again.lost else 'finds it')
    evaluations = found.evaluations + again.evaluations
    if not better:
        return replace(found, evaluations=evaluations)
    for each in seen:
        assert watch is not None
        watch(each)
    return replace(again, evidence_of=other.kind, evaluations=evaluations)


def evidence_of(estimate: PoseEstimate, evidence: EvidenceVolume) -> EvidenceVolume:
    """What pose and numbers of an estimate are of: this evidence of a capture, or its other."""
    if not estimate.evidence_of:
        return evidence
    other = evidence.other() if isinstance(evidence, EdgeVolume) and evidence.other else None
    assert other is not None  # it was searched
    return other


def _shows(evaluator: Evaluator, evidence: EvidenceVolume, pose: NDArray[np.float64]) -> bool:
    """Whether the contour of a pose (4, 4) is more likely present than absent."""
    points = evaluator.contour(evidence, pose)
    return bool(points.lengths @ points.evidence > 0)


def _has_more(one: PoseEstimate, other: PoseEstimate, evaluator: Evaluator,
              evidence: Sequence[EvidenceVolume]) -> bool:
    """Whether one pose has more evidence than another, by several kinds together."""
    poses = np.stack([one.pose, other.pose])
    first, second = np.sum([evaluator.evidence(each, poses) for each in evidence], axis=0)
    return bool(first > second)
