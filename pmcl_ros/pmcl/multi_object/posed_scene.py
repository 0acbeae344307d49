"""ViewsEvidence -> SceneEstimate: several objects in posed views, in their reference frame."""

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_object.penetration import (
    MAX_PENETRATION,
    Interior,
    PlacedObject,
    outside_of,
    resolve_penetration,
)
from pmcl_ros.pmcl.multi_object.scene_estimate import ListedObjects, SceneEstimate
from pmcl_ros.pmcl.multi_object.visibility import residual_edges
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.multi_view.other_objects import OtherObjects
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.progress import Progress

_LOG = logging.getLogger(__name__)
_ITS_OWN = 0.5  # share of an object's evidence that must be left beside those that were found
_LIKELY = 8.4  # nat: half the 99 % quantile of chi-squared, of 6 degrees of freedom


class PosedSceneLocalizer(Closing):
    """Finds several objects in several views (docs/concepts/several.md).

    Matching pursuit: each object is searched for alone; the one with the most evidence is there,
    and what it explains is no evidence of another. Objects that lose theirs by this, and those
    that were not found, are searched for in what is left, outside of it.
    models: listed; copies are the same ObjectModel.
    Raises LocalizationError for no or too many objects, or equal names.
    """

    def __init__(self, models: Sequence[ObjectModel], settings: PmclSettings) -> None:
        self._objects = ListedObjects.from_models(models, settings)
        self._localizers = [MultiViewLocalizer(each, settings)
                            for each in self._objects.distinct]
        self.renderer = self._localizers[0].renderer

    def localize(self, evidence: ViewsEvidence, rng: np.random.Generator,
                 progress: Progress | None = None) -> SceneEstimate:
        """The poses of the listed objects in the reference frame.

        progress: called with 0..1; returning False ends the search: what is not found by then is
        lost.
        Raises as `MultiViewLocalizer.localize`.
        """
        search = _MatchingPursuit(self._localizers, self._objects.interiors, evidence,
                                  rng, progress or (lambda _: True))
        found = search.run(self._objects.numbers)
        # Copies are named along the x axis of the reference frame.
        return self._objects.estimate(self._apart(found), search.alone, lambda pose: pose[0, 3])

    def _apart(self, found: Sequence[PoseEstimate]) -> list[PoseEstimate]:
        """The estimates after `resolve_penetration`; of two that cannot be apart one is lost."""
        result = list(found)
        places = [k for k, each in enumerate(result) if not each.lost]
        resolved = resolve_penetration([self._placed(k, result[k]) for k in places])
        for k, off in zip(places, resolved.deviations, strict=True):
            if off.any():
                result[k] = result[k].moved(off)
        if resolved.depth > MAX_PENETRATION:
            worst = min((places[k] for k in resolved.pair), key=lambda k: result[k].score)
            result[worst] = replace(result[worst], lost=True)
        return result

    def _placed(self, place: int, estimate: PoseEstimate) -> PlacedObject:
        objects = self._objects
        return PlacedObject.from_estimate(objects.interiors[objects.numbers[place]], estimate,
                                          objects.models[place].symmetry)


class _MatchingPursuit:
    """The joint search in one capture.

    localizers, interiors: of the distinct objects. alone: the estimates of the separate searches.
    """

    def __init__(self, localizers: Sequence[MultiViewLocalizer], interiors: Sequence[Interior],
                 evidence: ViewsEvidence, rng: np.random.Generator, progress: Progress) -> None:
        self._localizers, self._interiors = localizers, interiors
        self._whole = self._left = evidence
        self._rng, self._progress, self._stopped, self._done = rng, progress, False, 0
        self._there: list[tuple[int, PoseEstimate]] = []  # number of the object, where it is
        self.alone: list[PoseEstimate] = []

    def run(self, listed: Sequence[int]) -> list[PoseEstimate]:
        """The estimates of the listed objects, by their numbers."""
        self._searches = len(self._localizers) * (1 + len(listed))
        for number in range(len(self._localizers)):
            # Who stops the search wants the rest of it no more.
            self.alone.append(replace(self.alone[-1], lost=True) if self._stopped
                              else self._search(number))
        best = dict(enumerate(self.alone))
        waiting, found = list(range(len(listed))), dict[int, PoseEstimate]()
        while waiting:
            numbers = {listed[place] for place in waiting}
            there = [number for number in sorted(numbers) if not best[number].lost]
            if not there or self._stopped:
                break
            number = max(there, key=lambda each: best[each].score)
            place = next(each for each in waiting if listed[each] == number)
            waiting.remove(place)
            found[place] = best[number]
            self._accept(number, best[number])
            for each in sorted({listed[one] for one in waiting}):
                if not self._stands(each, best[each]) and not self._stopped:
                    best[each] = self._search(each)
        return [found[place] if place in found else replace(best[number], lost=True)
                for place, number in enumerate(listed)]

    def _search(self, number: int) -> PoseEstimate:
        """Search for one object in what is left, outside of what is there."""
        begin, self._done = self._done, self._done + 1

        def progress(done: float) -> bool:
            part = min((begin + done) / self._searches, 1.0)
            self._stopped = self._stopped or not self._progress(part)
            return not self._stopped

        localizer, rng = self._localizers[number], self._rng.spawn(1)[0]
        if not self._there:
            return localizer.localize(self._whole, rng, progress)
        _LOG.info('%s is searched for in the residual evidence of %d objects',
                  localizer.model.name, len(self._there))
        others = self._others(number)
        found = localizer.candidate(self._left, rng, progress, others)
        # What it shares with the others is no part that is missing: the whole evidence judges.
        modes = np.stack([each.pose for each in found.modes])
        judged = localizer.localize(self._whole, rng, lambda _: progress(1.0), modes,
                                    others=others)
        possible = others.feasible(judged.pose[None])[0] and self._stands(number, judged)
        return judged if possible else replace(found, lost=True)

    def _accept(self, number: int, estimate: PoseEstimate) -> None:
        """An object is there: what it explains is no evidence of another."""
        self._there.append((number, estimate))
        contours = self._localizers[number].contours(self._left, estimate.pose)
        self._left = replace(self._left, views=tuple(
            replace(each, evidence=residual_edges(each.evidence, [contours[view]]))
            if view in contours else each for view, each in enumerate(self._left.views)))

    def _stands(self, number: int, estimate: PoseEstimate) -> bool:
        """Whether an object that was found before can stand beside what is there."""
        if estimate.lost or not self._fits(number, estimate):
            return False
        others = self._others(number)
        left, whole = (float(self._localizers[number].evidence(each, estimate.pose[None],
                                                               others)[0])
                       for each in (self._left, self._whole))
        return left > _ITS_OWN * whole

    def _fits(self, number: int, estimate: PoseEstimate) -> bool:
        """Whether an object is outside of all that is there, or can be by what is known."""
        ours = self._placed(number, estimate)
        for other, where in self._there:
            resolved = resolve_penetration([ours, self._placed(other, where)], _LIKELY)
            if resolved.depth > MAX_PENETRATION or resolved.cost > _LIKELY:
                return False
        return True

    def _others(self, number: int) -> OtherObjects:
        """What is there beside an object."""
        outside = outside_of(self._interiors[number], [(self._interiors[other], where.pose)
                                                       for other, where in self._there])
        return OtherObjects(outside, [(self._localizers[other].model, where.pose)
                                      for other, where in self._there])

    def _placed(self, number: int, estimate: PoseEstimate) -> PlacedObject:
        return PlacedObject.from_estimate(self._interiors[number], estimate,
                                          self._localizers[number].model.symmetry)
