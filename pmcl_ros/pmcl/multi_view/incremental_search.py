"""Views that come one after the other: a search goes on from what the last one found."""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.runtime.progress import Progress

_LOG = logging.getLogger(__name__)
_PARTICLES = 32  # of the last posterior, from which the search begins beside its modes


@dataclass(frozen=True)
class _Last:
    """The last search: what it read, and what it found."""

    evidence: ViewsEvidence
    estimate: PoseEstimate

    def leads_to(self, evidence: ViewsEvidence) -> bool:
        """Whether other evidence is of the same views, which all show the object, and of more."""
        if self.estimate.lost or self.estimate.hidden:
            return False
        theirs = {id(each.evidence): each.camera_to_reference for each in evidence.views}
        return len(evidence.views) > len(self.evidence.views) and all(
            np.array_equal(each.camera_to_reference, theirs.get(id(each.evidence), ()))
            for each in self.evidence.views)


class IncrementalSearch:
    """`MultiViewLocalizer.localize` of a collection that grows.

    Where all views of the last search came again, with others, and all showed the object, the
    search begins at its posterior. It begins at proposals, in the whole region, where that leads
    to no pose, and with all other views; the log says which. It holds the last evidence.
    localizer: the caller closes it.
    """

    def __init__(self, localizer: MultiViewLocalizer) -> None:
        self._localizer = localizer
        self._last: _Last | None = None

    def reset(self) -> None:
        """The next views are searched in the whole region."""
        self._last = None

    def localize(self, evidence: ViewsEvidence, rng: np.random.Generator,
                 progress: Progress | None = None) -> PoseEstimate:
        """As `MultiViewLocalizer.localize`."""
        last, self._last = self._last, None
        found = None
        if last is not None and last.leads_to(evidence):
            found = self._localizer.localize_near(evidence, rng, _poses(last.estimate, rng),
                                                  progress)
            added = len(evidence.views) - len(last.evidence.views)
            _LOG.info('searched with views added (%d) from the last pose%s', added,
                      ', where it is not: searching the region of interest' if found.lost else '')
        if found is None or found.lost:
            found = self._localizer.localize(evidence, rng, progress)
        self._last = _Last(evidence, found)
        return found

    def follow(self, evidence: ViewsEvidence, prior: Gaussian, rng: np.random.Generator,
               particles: int, candidates: int) -> PoseEstimate:
        """As `MultiViewLocalizer.follow`."""
        return self._localizer.follow(evidence, prior, rng, particles, candidates)

    def log_likelihoods(self, evidence: ViewsEvidence, poses: NDArray[np.float64]
                        ) -> NDArray[np.float64]:
        """As `MultiViewLocalizer.log_likelihoods`."""
        return self._localizer.log_likelihoods(evidence, poses)


def _poses(estimate: PoseEstimate, rng: np.random.Generator) -> NDArray[np.float64]:
    """(n, 4, 4) the modes of a posterior, and some of its particles."""
    chosen = rng.choice(len(estimate.particles), min(_PARTICLES, len(estimate.particles)), False)
    return np.concatenate([np.stack([each.pose for each in estimate.modes]),
                           estimate.particles[chosen]])
