"""Objects looked for where they are and where they are not: what the search makes of both."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evaluation.errors import pose_error
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.learning.contour_errors import Deviation
from pmcl_ros.learning.contour_tables import Example
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError

_OTHERS = 1  # objects looked for in a scene that are in others


@dataclass(frozen=True)
class Search:
    """there: whether the object is in the scene. support, evidence: of the pose found
    (`PoseEstimate`).

    deviation: of that pose, where it is the object's; else None.
    """

    there: bool
    support: float
    evidence: float
    deviation: Deviation | None = None


def searches(examples: Iterable[Example], profile: ContourProfile, seed: int
             ) -> Iterator[Search]:
    """Look in each scene for its own object, there or not, and for those of the scenes before.

    The edge volumes must reach as far as any of the objects does.
    """
    before: list[ObjectModel] = []
    for each in examples:
        estimate = found(each, each.model, profile, seed)
        deviation = None
        if each.there:
            error = pose_error(estimate.pose, each.pose, each.model.symmetry)
            if error.right:
                deviation = Deviation.of(each, estimate, profile, NumbaRenderer())
        yield Search(each.there, estimate.support, estimate.evidence, deviation)
        for other in before:
            estimate = found(each, other, profile, seed)
            yield Search(False, estimate.support, estimate.evidence)
        before = [*before, each.model][-_OTHERS:]


@dataclass(frozen=True)
class Supports:
    """Of the best pose found for objects: there (n,), elsewhere (m,).

    evidence: (k,) of the poses found of those that are there.
    """

    there: NDArray[np.float64]
    elsewhere: NDArray[np.float64]
    evidence: NDArray[np.float64]

    @classmethod
    def of(cls, found: Sequence[Search]) -> 'Supports':
        """Raises LocalizationError when no object was looked for that is not there."""
        there = np.array([each.there for each in found], bool)
        support = np.array([each.support for each in found])
        if there.all():
            raise LocalizationError('it takes two scenes to look for an object that is not there')
        evidence = np.array([each.evidence for each in found if each.deviation is not None])
        return cls(support[there], support[~there], evidence)

    def threshold(self, false_alarms: float) -> float:
        """The least support that only this share of the objects that are elsewhere has."""
        return float(np.quantile(self.elsewhere, 1 - false_alarms))

    def least_evidence(self, missed: float) -> float:
        """What only this share of the objects found has less than."""
        return float(np.quantile(self.evidence, missed))

    def missed(self, least: float) -> float:
        """Share of the objects there whose support is less."""
        return float((self.there < least).mean())


def found(example: Example, model: ObjectModel, profile: ContourProfile, seed: int
          ) -> PoseEstimate:
    """What the search makes of a model in an example's edge volume."""
    settings = PmclSettings(roi_center=example.region.center, roi_size=example.region.size,
                            renderer='numba')
    with Localizer(model, settings, profile) as localizer:
        return localizer.localize(example.edges, np.random.default_rng(seed))
