"""The search for several objects in one capture."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.local_model import Observation, weighted
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.candidates import Candidates, Member, support_beside
from pmcl_ros.pmcl.multi_object.penetration import (
    MAX_PENETRATION,
    Interior,
    PlacedObject,
    outside_of,
    resolve_penetration,
)
from pmcl_ros.pmcl.multi_object.visibility import residual_edges, visible_evidence
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.posterior import Feasible
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.runtime.progress import Progress

_LOG = logging.getLogger(__name__)
_WHOLE = 0.999  # share of a contour that counts; more is the whole
_ALONE, _AGAIN = 0.7, 0.3  # shares of the time: separate searches, searches for missing objects


class SceneSearch:
    """The joint search in one capture.

    models, interiors, localizers: of the distinct objects. listed: (n,) index of the object that
    is searched for. The rest as in `SceneLocalizer.localize` and `Candidates`.
    """

    def __init__(self, localizers: Sequence[Localizer], models: Sequence[ObjectModel],
                 interiors: Sequence[Interior], listed: Sequence[int], edges: EvidenceVolume,
                 rng: np.random.Generator, progress: Progress, least: float, least_support: float
                 ) -> None:
        self._localizers, self._models, self._interiors = localizers, models, interiors
        self._listed, self._edges, self._rng = listed, edges, rng
        self._progress, self._done, self._stopped = progress, 0.0, False
        self._least, self._least_support = least, least_support
        self._candidates = Candidates(models, interiors, listed, least, least_support)
        self.alone: list[PoseEstimate] = []
        self._searches: list[list[tuple[PoseEstimate, Member]]] = [[] for _ in models]

    def run(self) -> list[PoseEstimate]:
        """The estimates of the listed objects."""
        for number in range(len(self._models)):
            self.alone.append(self._search(number, self._edges, None, _ALONE / len(self._models)))
            if self._stopped:  # nobody wants the rest
                lost = replace(self.alone[-1], lost=True)
                self.alone += [lost] * (len(self._models) - len(self.alone))
                return [lost] * len(self._listed)
        assigned = self._search_missing(self._candidates.assigned())
        while True:
            estimates = self._estimates(assigned)
            gone = {member: each.support for member, each in zip(assigned, estimates, strict=True)
                    if member is not None and each.lost}
            if not gone:
                return estimates
            self._candidates.exclude(min(gone, key=lambda each: (gone[each], each)))
            assigned = self._candidates.assigned()

    def _search_missing(self, assigned: list[Member | None]) -> list[Member | None]:
        """Search for missing objects in the residual edges, until no more are found."""
        searched: dict[int, set[Member]] = {}
        for _ in self._listed:
            there = {each for each in assigned if each is not None}
            missing = sorted({number for number, each in zip(self._listed, assigned, strict=True)
                              if each is None and searched.get(number, set()) != there})
            if not missing or not there or self._stopped:
                break
            left = residual_edges(self._edges, [self._visible_points(each, assigned)
                                                for each in sorted(there)])
            for number in missing:
                _LOG.info('%s is searched for in the residual edges of %d objects',
                          self._models[number].name, len(there))
                self._search(number, left, self._feasible(number, there),
                             _AGAIN / len(self._listed))
                searched[number] = there
            assigned = self._candidates.assigned()
        return assigned

    def _search(self, number: int, edges: EvidenceVolume, feasible: Feasible | None, part: float
                ) -> PoseEstimate:
        """Search for one object alone, and add the modes to the candidates."""
        begin = self._done

        def progress(done: float) -> bool:
            self._done = begin + done * part
            self._stopped = self._stopped or not self._progress(min(self._done, 1.0))
            return not self._stopped

        localizer = self._localizers[number]
        found = localizer.localize(edges, self._rng.spawn(1)[0], progress, feasible=feasible)
        modes = [each.pose for each in found.modes]
        members = self._candidates.add(number, localizer.observe(self._edges, modes))
        self._searches[number].append((found, members[0]))
        return found

    def _feasible(self, number: int, there: set[Member]) -> Feasible:
        """Feasible poses of an object beside others."""
        return outside_of(self._interiors[number], [
            (self._interiors[each[0]], self._candidates[each].pose) for each in sorted(there)])

    def _visible_points(self, member: Member, assigned: Sequence[Member | None]) -> ContourPoints:
        observation = self._candidates[member]
        seen = visible_evidence(observation.points, self._candidates.others(member, assigned),
                                self._candidates.scale(member[0]))
        return weighted(observation.points, seen.weights)

    def _estimates(self, assigned: Sequence[Member | None]) -> list[PoseEstimate]:
        """Estimates of the listed objects: refined beside the others, without penetration.

        From front to back: a nearer object occludes those behind it, and has the shared edges.
        """
        observations = {each: self._candidates[each] for each in assigned if each is not None}
        found: dict[Member, PoseEstimate] = {}
        for member in sorted(observations, key=lambda each: (observations[each].pose[2, 3], each)):
            others = [seen for each, seen in observations.items() if each != member]
            found[member] = self._estimate(member, observations[member], others)
            observations[member] = self._at(member, found[member].pose)
        found = self._resolved(found, observations)
        return [self._lost(number, observations) if member is None else found[member]
                for number, member in zip(self._listed, assigned, strict=True)]

    def _lost(self, number: int, there: Mapping[Member, Observation]) -> PoseEstimate:
        """The estimate of a lost object: the best of its searches, beside the others."""
        worth = [self._candidates.value(member, there) for _, member in self._searches[number]]
        return replace(self._searches[number][int(np.argmax(worth))][0], lost=True)

    def _estimate(self, member: Member, observation: Observation,
                  others: Sequence[Observation]) -> PoseEstimate:
        number, scale = member[0], self._candidates.scale(member[0])
        alone = self.alone[number]
        if visible_evidence(observation.points, others, scale).share > _WHOLE and np.array_equal(
                alone.modes[0].pose, observation.pose):
            return alone  # the other objects change nothing
        return self._localizers[number].refine(
            self._edges, observation.pose, self._rng.spawn(1)[0],
            lambda points: visible_evidence(points, others, scale).weights)

    def _at(self, member: Member, pose: NDArray[np.float64]) -> Observation:
        return self._localizers[member[0]].observe(self._edges, [pose])[0]

    def _resolved(self, found: dict[Member, PoseEstimate], observations: dict[Member, Observation]
                  ) -> dict[Member, PoseEstimate]:
        """The estimates after `resolve_penetration`."""
        members = [each for each in found if not found[each].lost]
        resolved = resolve_penetration([
            PlacedObject.from_estimate(self._interiors[each[0]], found[each],
                                      self._models[each[0]].symmetry) for each in members])
        for member, off in zip(members, resolved.deviations, strict=True):
            if not off.any():
                continue
            moved = found[member].moved(off)
            observations[member] = self._at(member, moved.pose)
            others = [seen for each, seen in observations.items() if each != member]
            scale = self._candidates.scale(member[0])
            support = support_beside(observations[member], others, scale, self._least)
            found[member] = replace(moved, support=support, lost=support < self._least_support)
        if resolved.depth > MAX_PENETRATION:  # both cannot be present
            worst = min((members[k] for k in resolved.pair), key=lambda each: found[each].support)
            found[worst] = replace(found[worst], lost=True)
        return found
