"""The state of a track, and the rules by which an estimate is accepted as the tracked object."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.estimate import FOLLOWED, PoseEstimate
from pmcl_ros.pmcl.modes import MODE_EXTENT
from pmcl_ros.pmcl.tracking.action import State

# nat: log-prior penalty of re-detection over prediction. A region (20 cm, all orientations) holds
# so many more poses than one step of the motion model (1 cm, 0.06 rad).
REDETECTION_PENALTY = 15.0
GATE_PROBABILITY = 0.99  # of the prediction: an estimate outside of that ellipsoid is unexpected
LEAST_IN_VIEW = 0.5  # share of the object; with less, only the single-frame test counts
# Captures for which an incomplete contour is accepted after the region was searched in vain.
CONFIRMED_CAPTURES = 30
# nat / px: least standard deviations that are assumed of the track's history, to reject an
# estimate that passes the single-frame test, and to doubt its evidence.
REJECT_SIGMA, DOUBT_SIGMA = 0.5, 0.2

_HISTORY, _ENOUGH = 30, 10  # captures: that are stored, that make the statistics known
_UNLIKELY = 3.0  # standard deviations below the mean
_TYPICAL = 2 ** 0.5  # root of the sum of squares of both deviations, in standard deviations


@dataclass(frozen=True)
class Prediction:
    """The belief before a capture: particles, their mean pose (4, 4) and covariance (6, 6)."""

    state: State
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @classmethod
    def from_state(cls, state: State, symmetry: Symmetry) -> 'Prediction':
        """Of the equally weighted particles of a state."""
        mean = symmetry.mean_pose(state.poses)
        return cls(state, mean, symmetry.covariance(state.poses, mean))


class TrackStatistics:
    """Mean and standard deviation of the contour's support and evidence while it was observed.

    They adapt to the last 30 captures, so an object that fades slowly is followed down to zero
    evidence.
    """

    def __init__(self) -> None:
        self._values: deque[tuple[float, float]] = deque(maxlen=_HISTORY)

    @property
    def known(self) -> bool:
        """Whether the object was observed often enough."""
        return len(self._values) >= _ENOUGH

    def clear(self) -> None:
        """Forget all captures."""
        self._values.clear()

    def forget_oldest(self) -> None:
        """Forget one capture, when the object was not observed: its look may change."""
        if self._values:
            self._values.popleft()

    def add(self, estimate: PoseEstimate) -> None:
        """Add the support and the evidence of an observation."""
        if np.isfinite([estimate.support, estimate.evidence]).all():
            self._values.append((estimate.support, estimate.evidence))

    def within_three_sigma(self, estimate: PoseEstimate, least_sigma: float) -> NDArray[np.bool_]:
        """(2,) whether support and evidence are at most 3 sigma below their means.

        least_sigma: assumed at least [nat / px]. True while the statistics are not known.
        """
        if not self.known:
            return np.ones(2, bool)
        scatter = np.maximum(np.std(self._values, axis=0), least_sigma)
        return np.array([estimate.support, estimate.evidence] >= (
            np.mean(self._values, axis=0) - _UNLIKELY * scatter))

    def is_typical(self, estimate: PoseEstimate) -> bool:
        """Whether the statistics are known and both values are about the mean or above."""
        if not self.known:
            return False
        below = (np.mean(self._values, axis=0) - [estimate.support, estimate.evidence]
                 ) / np.maximum(np.std(self._values, axis=0), DOUBT_SIGMA)
        return bool(np.linalg.norm(np.maximum(below, 0)) <= _TYPICAL)

    def has_half_evidence(self, estimate: PoseEstimate) -> bool:
        """Whether the evidence is at least half of its mean, or the statistics are not known."""
        return not self.known or bool(
            estimate.evidence >= max(np.mean(self._values, axis=0)[1], 0) / 2)


@dataclass
class Track:
    """The state of one track, and the rules of acceptance.

    state: the belief after the last capture; None without a track. observed: whether the object
    was accepted in the last capture. since_search: captures that were followed since the region
    was last searched. confirmations: region searches since the object was found that confirmed
    the followed pose.
    """

    symmetry: Symmetry
    state: State | None = None
    observed: bool = False
    since_search: int = 0
    confirmations: int = 0
    statistics: TrackStatistics = field(default_factory=TrackStatistics)

    def drop(self) -> None:
        """End the track; the statistics are kept, as the object looks as before."""
        self.state, self.observed, self.confirmations = None, False, 0

    def passes_gate(self, estimate: PoseEstimate, prediction: Prediction | None) -> bool:
        """Accept if the single-frame test passes and scores lie within 3 sigma of the history.

        An incomplete contour fails the single-frame test. It is accepted all the same where the
        history explains it: of a followed object, for 30 captures after a search that confirmed
        it; of a new detection, if its scores are typical.
        """
        followed = self.observed and estimate.mode == FOLLOWED
        if estimate.incomplete:
            if estimate.in_view < LEAST_IN_VIEW:
                return False
            if estimate.mode != FOLLOWED:
                return ((not self.observed or prediction is None)
                        and self.statistics.is_typical(estimate))
            return (followed and self.confirmations > 0
                    and self.since_search <= CONFIRMED_CAPTURES
                    and self.has_usual_evidence(estimate)
                    and self.in_validation_gate(estimate, prediction))
        if estimate.lost:
            return False
        if followed or (self.observed and self.in_validation_gate(estimate, prediction)):
            return bool(self.statistics.within_three_sigma(estimate, REJECT_SIGMA).all())
        return self.statistics.has_half_evidence(estimate)

    def matches_history(self, estimate: PoseEstimate, prediction: Prediction, agree: bool) -> bool:
        """Accept the likelier one of two estimates, although the single-frame test may fail.

        It must be predicted and have its usual evidence: an occluder does not look like the
        object exactly where that is predicted. While the statistics are not known, tracking and
        the search of the region must `agree` on the pose.
        """
        plausible = self.has_usual_evidence(estimate) if self.statistics.known else (
            estimate.incomplete and self.observed and agree)
        return (plausible and estimate.in_view >= LEAST_IN_VIEW
                and self.in_validation_gate(estimate, prediction))

    def in_validation_gate(self, estimate: PoseEstimate, prediction: Prediction | None) -> bool:
        """Whether the pose lies in the 99 % region of the prediction."""
        return prediction is not None and self.symmetry.credible_level(
            estimate.pose, prediction.mean, prediction.covariance) <= GATE_PROBABILITY

    def has_usual_evidence(self, estimate: PoseEstimate) -> bool:
        """Whether the statistics are known and the evidence is positive and not below 3 sigma."""
        return (estimate.evidence > 0 and self.statistics.known
                and bool(self.statistics.within_three_sigma(estimate, DOUBT_SIGMA)[1]))

    def select(self, followed: PoseEstimate, detected: PoseEstimate, log_ratio: float,
               prediction: Prediction) -> tuple[PoseEstimate, bool]:
        """The likelier of a followed pose and of one detected in the region; whether accepted.

        log_ratio: log likelihood of the detected pose over that of the followed one [nat]. The
        less likely pose is accepted where it passes the gate and the likelier one fails. The
        track is dropped where the object was accepted elsewhere than it was followed.
        """
        agree = bool(self.symmetry.same_mode(detected.pose[None], followed.pose,
                                             *MODE_EXTENT).all())
        # A lost object is predicted no better by what is followed than by what is detected.
        stays = agree or log_ratio < (REDETECTION_PENALTY if self.observed else 0)
        likelier, other = (followed, detected) if stays else (detected, followed)
        was_tracked = self.observed and self.passes_gate(followed, prediction)
        accepted = (self.passes_gate(likelier, prediction)
                    or self.matches_history(likelier, prediction, agree))
        self.since_search = 0
        if accepted:
            if stays:
                self.confirmations += 1
            elif was_tracked:
                self.drop()
            return likelier, True
        if not other.incomplete and self.passes_gate(other, prediction):
            self.confirmations = 0  # the comparison spoke against it
            return other, True
        return likelier, False
