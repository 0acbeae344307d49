"""Searches for objects in scenes with and without them: support and evidence of both."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.learning.contour_errors import LENGTH, Deviation
from pmcl_ros.learning.contour_tables import Example
from pmcl_ros.learning.support_slopes import support_slopes
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.estimator import Thresholds
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.support import log_odds
from pmcl_ros.runtime.errors import LocalizationError

_NO_ERROR = ModelError(0, 0, LENGTH)  # it is what the searches are to teach
_OTHERS = 1  # objects of other scenes that each scene is searched for


@dataclass(frozen=True)
class Search:
    """One search. there: whether the object is in the scene.

    support, evidence: of the pose found (`PoseEstimate`). weight: of its mode. deviation: of that
    pose from the truth; None where the pose is wrong.
    """

    there: bool
    support: float
    evidence: float
    weight: float
    deviation: Deviation | None = None

    def margin(self, slopes: tuple[float, float]) -> float:
        """The support, and what takes its place (`Thresholds.slopes`); -inf without a contour."""
        if not math.isfinite(self.support):
            return -math.inf
        return self.support + slopes[0] * self.evidence + slopes[1] * log_odds(self.weight)

    def is_claimed(self, least: Thresholds) -> bool:
        """Whether the object counts as found, by these thresholds."""
        return (self.evidence >= least.evidence and self.weight >= least.weight
                and self.support >= least.needed(self.evidence, self.weight))


def slopes_of(found: Sequence[Search], least_weight: float) -> tuple[float, float]:
    """`Thresholds.slopes`, by the searches whose pose has this weight at least.

    Raises LocalizationError where support does not tell right poses from objects elsewhere.
    """
    clear = [each for each in found
             if each.weight >= least_weight and np.isfinite(each.support)]
    of_evidence, of_odds = support_slopes(*(
        [[each.support, each.evidence, log_odds(each.weight)] for each in group]
        for group in ([each for each in clear if each.deviation is not None],
                      [each for each in clear if not each.there])))
    return float(of_evidence), float(of_odds)


def searches(examples: Iterable[Example], profile: ContourProfile | None, seed: int
             ) -> Iterator[Search]:
    """Search each scene for its own object, and for the object of the scene before.

    profile: None for that of the evidence.

    The depths of the edge volumes must hold all of these objects.
    """
    before: list[ObjectModel] = []
    for each in examples:
        estimate = found(each, each.model, profile, seed)
        deviation = None
        if each.there:
            error = pose_error(estimate.pose, each.pose, each.model.symmetry)
            if error.right:
                deviation = Deviation.from_estimate(
                    each, estimate, profile or each.volume.profile, NumbaRenderer())
        yield Search(each.there, estimate.support, estimate.evidence, estimate.modes[0].weight,
                     deviation)
        for other in before:
            estimate = found(each, other, profile, seed)
            yield Search(False, estimate.support, estimate.evidence, estimate.modes[0].weight)
        before = [*before, each.model][-_OTHERS:]


@dataclass(frozen=True)
class Supports:
    """Support of the best pose: of objects in the scene (n,) and of objects elsewhere (m,).

    With what takes its place (`Search.margin`), if anything does. evidence: (k,) of the right
    poses.
    """

    there: NDArray[np.float64]
    elsewhere: NDArray[np.float64]
    evidence: NDArray[np.float64]

    @classmethod
    def from_searches(cls, found: Sequence[Search], least_weight: float = 0.0,
                      slopes: tuple[float, float] = (0.0, 0.0)) -> 'Supports':
        """Of all searches; poses of less weight have no support. slopes: as of `Thresholds`.

        Raises LocalizationError when each object was in its scene.
        """
        there = np.array([each.there for each in found], bool)
        support = np.array([each.margin(slopes) if each.weight >= least_weight else -np.inf
                            for each in found])
        if there.all():
            raise LocalizationError('0 searches for an object that is not in its scene; learn '
                                    'from three scenes at least, in each half of them two')
        evidence = np.array([each.evidence for each in found if each.deviation is not None])
        if not len(evidence):
            raise LocalizationError(f'none of {there.sum()} searches found its object: the scenes '
                                    'show too little of it to learn from')
        return cls(support[there], support[~there], evidence)

    def threshold(self, false_alarms: float) -> float:
        """The support that only this share of the objects elsewhere exceeds."""
        return float(np.quantile(self.elsewhere, 1 - false_alarms))

    def least_evidence(self, missed: float) -> float:
        """The evidence below which only this share of the right poses lies."""
        return float(np.quantile(self.evidence, missed))

    def missed(self, least: float) -> float:
        """Share of the objects in the scene with less support."""
        return float((self.there < least).mean())


def found(example: Example, model: ObjectModel, profile: ContourProfile | None, seed: int
          ) -> PoseEstimate:
    """The pose that the search finds for a model in an example's edge volume.

    Its covariance is without a model error, and whether it is lost says nothing: the thresholds
    and the error are learned from it, and the file that holds them is not read.
    """
    settings = PmclSettings(roi_center=example.region.center, roi_size=example.region.size,
                            renderer='numba', least_support=0)
    with Localizer(model, settings, profile, error=_NO_ERROR) as localizer:
        return localizer.localize(example.volume, np.random.default_rng(seed))
