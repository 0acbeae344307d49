"""The search for several objects in one capture."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.contour_evidence import Free
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.candidates import Candidates, Member, support_beside
from pmcl_ros.pmcl.multi_object.penetration import DEEPEST, Placed, apart
from pmcl_ros.pmcl.multi_object.residual_edges import unexplained
from pmcl_ros.pmcl.multi_object.solid import Solid
from pmcl_ros.pmcl.multi_object.visibility import sight
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.contour_points import ContourPoints
from pmcl_ros.pmcl.tracking.observation import Observation, weighted
from pmcl_ros.runtime.progress import Progress

_LOG = logging.getLogger(__name__)
_WHOLE = 0.999  # share of a contour that counts, from which on it is whole
_ALONE, _AGAIN = 0.7, 0.3  # shares of the time: of the searches alone, and of what is missing



class SceneSearch:
    """Of one capture: what `SceneLocalizer` does with it.

    models, solids, localizers: of the distinct objects. listed: (n,) which of them is looked for.
    The rest as of `SceneLocalizer.localize` and `Candidates`.
    """

    def __init__(self, localizers: Sequence[Localizer], models: Sequence[ObjectModel],
                 solids: Sequence[Solid], listed: Sequence[int], edges: EdgeVolume,
                 rng: np.random.Generator, progress: Progress, least: float, least_support: float
                 ) -> None:
        self._localizers, self._models, self._solids = localizers, models, solids
        self._listed, self._edges, self._rng = listed, edges, rng
        self._progress, self._done, self._stopped = progress, 0.0, False
        self._least, self._least_support = least, least_support
        self._candidates = Candidates(models, solids, listed, least, least_support)
        self.alone: list[PoseEstimate] = []
        self._searches: list[list[tuple[PoseEstimate, Member]]] = [[] for _ in models]

    def run(self) -> list[PoseEstimate]:
        """Of the listed objects."""
        for number in range(len(self._models)):
            self.alone.append(self._look(number, self._edges, None, _ALONE / len(self._models)))
        chosen = self._searched_again(self._candidates.chosen())
        while True:
            estimates = self._estimates(chosen)
            gone = {member: each.support for member, each in zip(chosen, estimates, strict=True)
                    if member is not None and each.lost}
            if not gone:
                return estimates
            self._candidates.bar(min(gone, key=lambda each: (gone[each], each)))
            chosen = self._candidates.chosen()

    def _searched_again(self, chosen: list[Member | None]) -> list[Member | None]:
        """Search what is missing in what is not explained yet, until that finds no more."""
        looked: dict[int, set[Member]] = {}
        for _ in self._listed:
            there = {each for each in chosen if each is not None}
            missing = sorted({number for number, each in zip(self._listed, chosen, strict=True)
                              if each is None and looked.get(number, set()) != there})
            if not missing or not there or self._stopped:
                break
            left = unexplained(self._edges, [self._shown(each, chosen)
                                                           for each in sorted(there)])
            for number in missing:
                _LOG.info('%s is searched for in what %d objects leave unexplained',
                          self._models[number].name, len(there))
                self._look(number, left, self._free(number, there), _AGAIN / len(self._listed))
                looked[number] = there
            chosen = self._candidates.chosen()
        return chosen

    def _look(self, number: int, edges: EdgeVolume, free: Free | None, part: float
              ) -> PoseEstimate:
        """Search for one object by itself; what is found is a candidate."""
        begin = self._done

        def progress(done: float) -> bool:
            self._done = begin + done * part
            self._stopped = self._stopped or not self._progress(min(self._done, 1.0))
            return not self._stopped

        localizer = self._localizers[number]
        found = localizer.localize(edges, self._rng.spawn(1)[0], progress, free=free)
        modes = [each.pose for each in found.modes]
        members = self._candidates.add(number, localizer.observe(self._edges, modes))
        self._searches[number].append((found, members[0]))
        return found

    def _free(self, number: int, there: set[Member]) -> Free:
        """Where the object can be beside the others: the largest balls in both are apart."""
        ours = self._solids[number]
        others = [(self._solids[each[0]], self._candidates[each].pose) for each in sorted(there)]

        def free(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
            centres = poses[:, :3, :3] @ ours.core + poses[:, :3, 3]
            possible = np.ones(len(poses), bool)
            for solid, pose in others:
                away = np.linalg.norm(centres - (pose[:3, :3] @ solid.core + pose[:3, 3]), axis=1)
                possible &= away > 0.8 * (ours.core_radius + solid.core_radius)
            return possible
        return free

    def _shown(self, member: Member, chosen: Sequence[Member | None]) -> ContourPoints:
        look = self._candidates[member]
        seen = sight(look.points, self._candidates.others(member, chosen),
                     self._candidates.scale(member[0]))
        return weighted(look.points, seen.weights)

    def _estimates(self, chosen: Sequence[Member | None]) -> list[PoseEstimate]:
        """Of the listed objects; what was chosen is refined beside the others, then moved apart.

        From front to back: what is nearer hides what is behind it, and has the edges of both.
        """
        looks = {each: self._candidates[each] for each in chosen if each is not None}
        found: dict[Member, PoseEstimate] = {}
        for member in sorted(looks, key=lambda each: (float(looks[each].pose[2, 3]), each)):
            others = [look for each, look in looks.items() if each != member]
            found[member] = self._estimate(member, looks[member], others)
            looks[member] = self._at(member, found[member].pose)
        found = self._apart(found, looks)
        return [self._lost(number, looks) if member is None else found[member]
                for number, member in zip(self._listed, chosen, strict=True)]

    def _lost(self, number: int, there: Mapping[Member, Observation]) -> PoseEstimate:
        """The best hypothesis about an object that is lost: of its searches, beside the others."""
        worth = [self._candidates.worth(member, there) for _, member in self._searches[number]]
        return replace(self._searches[number][int(np.argmax(worth))][0], lost=True)

    def _estimate(self, member: Member, look: Observation,
                  others: Sequence[Observation]) -> PoseEstimate:
        number, scale = member[0], self._candidates.scale(member[0])
        alone = self.alone[number]
        if sight(look.points, others, scale).share > _WHOLE and np.array_equal(
                alone.modes[0].pose, look.pose):
            return alone  # nothing is known now that was not before
        return self._localizers[number].refine(
            self._edges, look.pose, self._rng.spawn(1)[0],
            lambda points: sight(points, others, scale).weights)

    def _at(self, member: Member, pose: NDArray[np.float64]) -> Observation:
        return self._localizers[member[0]].observe(self._edges, [pose])[0]

    def _apart(self, found: dict[Member, PoseEstimate], looks: dict[Member, Observation]
               ) -> dict[Member, PoseEstimate]:
        """The estimates moved until none are in each other, by their covariances."""
        members = [each for each in found if not found[each].lost]
        things = []
        for each in members:
            basis = self._models[each[0]].symmetry.tangent_basis(found[each].pose)
            spread = basis @ basis.T @ found[each].covariance @ basis @ basis.T
            things.append(Placed(self._solids[each[0]], found[each].pose, spread))
        done = apart(things)
        for member, off in zip(members, done.deviations, strict=True):
            if not off.any():
                continue
            old = found[member]
            pose = retract(old.pose, off[None])[0]
            particles = retract(old.particles, np.tile(off, (len(old.particles), 1)))
            looks[member] = self._at(member, pose)
            others = [look for each, look in looks.items() if each != member]
            support = support_beside(looks[member], others, self._candidates.scale(member[0]),
                                     self._least)
            found[member] = replace(old, pose=pose, particles=particles, support=support,
                                    lost=support < self._least_support)
        if done.depth > DEEPEST:  # they do not go together after all
            worst = min((members[k] for k in done.pair), key=lambda each: found[each].support)
            found[worst] = replace(found[worst], lost=True)
        return found
