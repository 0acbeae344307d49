"""Searches for objects in scenes with and without them: support and evidence of both."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.learned import NO_SLOPES, SupportSlopes
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


@dataclass(frozen=True)
class Search:
    """One search. there: whether the object is in the scene.

    support, evidence, inside: of the pose found (`PoseEstimate`). weight: of its mode. deviation:
    of that pose from the truth; None where the pose is wrong.
    """

    there: bool
    support: float
    evidence: float
    weight: float
    inside: float
    deviation: Deviation | None = None

    @classmethod
    def from_estimate(cls, there: bool, estimate: PoseEstimate, deviation: Deviation | None = None
                      ) -> 'Search':
        """One that ended with an estimate."""
        return cls(there, estimate.support, estimate.evidence, estimate.modes[0].weight,
                   estimate.inside, deviation)

    def margin(self, slopes: SupportSlopes) -> float:
        """The support, and what takes its place; -inf without a contour."""
        if not math.isfinite(self.support):
            return -math.inf
        return self.support + slopes.instead(self.evidence, log_odds(self.weight), self.inside)

    def is_claimed(self, least: Thresholds) -> bool:
        """Whether the object counts as found, by these thresholds."""
        return (self.evidence >= least.evidence and self.weight >= least.weight
                and self.support >= least.needed(self.evidence, self.weight, self.inside))


def slopes_of(found: Sequence[Search], least_weight: float) -> SupportSlopes:
    """`Thresholds.slopes`, by the searches whose pose has this weight at least.

    Raises LocalizationError where support does not tell right poses from objects elsewhere.
    """
    clear = [each for each in found
             if each.weight >= least_weight and np.isfinite(each.support)]
    return SupportSlopes(*map(float, support_slopes(*(
        [[each.support, each.evidence, log_odds(each.weight), -each.inside] for each in group]
        for group in ([each for each in clear if each.deviation is not None],
                      [each for each in clear if not each.there])))))


def searches(example: Example, others: Sequence[ObjectModel], profile: ContourProfile | None,
             seed: int) -> Iterator[Search]:
    """Search a scene for its own object, and for others that are not there.

    profile: None for that of the evidence.

    The depths of an edge volume must hold all of these objects.
    """
    estimate = found(example, example.model, profile, seed)
    deviation = None
    if example.there and pose_error(estimate.pose, example.pose, example.model.symmetry).right:
        deviation = Deviation.from_estimate(
            example, estimate, profile or example.volume.profile, NumbaRenderer())
    yield Search.from_estimate(example.there, estimate, deviation)
    for other in others:
        yield Search.from_estimate(False, found(example, other, profile, seed))


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
                      slopes: SupportSlopes = NO_SLOPES) -> 'Supports':
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
