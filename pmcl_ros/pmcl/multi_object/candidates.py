"""Candidate poses of several objects in one capture, and their best joint assignment."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.local_model import Observation, weighted
from pmcl_ros.pmcl.modes import SAME_CANDIDATE
from pmcl_ros.pmcl.multi_object.penetration import (
    MAX_PENETRATION,
    Interior,
    PlacedObject,
    contact,
    resolve_penetration,
)
from pmcl_ros.pmcl.multi_object.visibility import visible_evidence
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.support import contour_support
from pmcl_ros.runtime.errors import LocalizationError

_MOST = 12  # candidates of an object
MOST_ASSIGNMENTS = 4_000_000  # all of them are compared

Member = tuple[int, int]  # number of the object, and of its candidate


class Candidates:
    """The candidates of one capture.

    models, interiors: of the distinct objects. listed: (n,) index of the object that is searched
    for, several times for copies. least: evidence [nat / px] above which a contour is more likely
    present than absent. least_support: as in `PmclSettings`.
    """

    def __init__(self, models: Sequence[ObjectModel], interiors: Sequence[Interior],
                 listed: Sequence[int], least: float, least_support: float) -> None:
        self._models, self._interiors, self._listed = models, interiors, listed
        self._least, self._least_support = least, least_support
        self._observations: list[list[Observation]] = [[] for _ in models]
        self._scales: dict[int, float] = {}
        self._excluded: set[Member] = set()
        self._pair_values: dict[tuple[Member, Member], float] = {}

    def __getitem__(self, member: Member) -> Observation:
        return self._observations[member[0]][member[1]]

    def add(self, number: int, observations: Sequence[Observation]) -> list[Member]:
        """Add poses of an object; for each the new candidate, or the known one of that pose."""
        model, ours, members = self._models[number], self._observations[number], []
        for new in observations:
            known = np.array([each.pose for each in ours]).reshape(-1, 4, 4)
            same = np.flatnonzero(model.symmetry.same_mode(known, new.pose, *SAME_CANDIDATE))
            members.append((number, int(same[0]) if len(same) else len(ours)))
            if not len(same):
                ours.append(new)
        if number not in self._scales and ours:
            self._scales[number] = max(ours, key=lambda each: each.local.evidence).local.scale
        return members

    def value(self, member: Member, beside: Iterable[Member]) -> float:
        """Log likelihood of a candidate beside others [nat]; -inf where it is impossible."""
        return self._own(member) + sum(self._pair(member, each) for each in beside)

    def scale(self, number: int) -> float:
        """Factor from an object's evidence to its log likelihood (`LocalModel.scale`).

        That of its best pose in the first search holds for all its candidates.
        """
        return self._scales[number]

    def exclude(self, member: Member) -> None:
        """Never assign a candidate again, nor those that overlap it with less evidence."""
        self._excluded |= {member} | self._weaker_overlapping(member)

    def assigned(self) -> list[Member | None]:
        """(n,) the best joint assignment of candidates that are all supported beside the others.

        A candidate without support is no object: it must not occlude others, nor take their edges
        or their place. So the one of least support is excluded, with those that overlap it, and
        the assignment is repeated.
        """
        excluded = set(self._excluded)
        while True:
            members = self._best(excluded)
            supports = {each: self.support(each, members) for each in members if each is not None}
            worst = min(supports, key=lambda each: (supports[each], each), default=None)
            if worst is None or supports[worst] >= self._least_support:
                return members
            excluded |= {worst} | self._weaker_overlapping(worst)

    def support(self, member: Member, beside: Sequence[Member | None]) -> float:
        """Support of a candidate's contour beside others (`support_beside`)."""
        return support_beside(self[member], self.others(member, beside), self.scale(member[0]),
                              self._least)

    def others(self, member: Member, beside: Sequence[Member | None]) -> list[Observation]:
        """The observations of the other members."""
        return [self[each] for each in beside if each is not None and each != member]

    def _best(self, excluded: set[Member]) -> list[Member | None]:
        most = min(_MOST, most_candidates(len(self._listed)))
        members = []
        for number, ours in enumerate(self._observations):
            free = [(number, k) for k in range(len(ours)) if (number, k) not in excluded]
            members.append(sorted(free, key=lambda each: -self._own(each))[:most])
        own = [np.array([self._own(each) for each in members[number]])
               for number in self._listed]
        pairs = {(i, j): np.array([[self._pair(one, other) for other in members[self._listed[j]]]
                                   for one in members[self._listed[i]]]
                                  ).reshape(len(own[i]), len(own[j]))
                 for j in range(len(own)) for i in range(j)}
        assignment = best_assignment(own, pairs)
        return [None if k is None else members[number][k]
                for number, k in zip(self._listed, assignment, strict=True)]

    def _weaker_overlapping(self, member: Member) -> set[Member]:
        """Candidates of the same object that overlap one and have less evidence."""
        number, interior = member[0], self._interiors[member[0]]
        return {(number, k) for k, other in enumerate(self._observations[number])
                if self._own((number, k)) < self._own(member)
                and contact(interior, other.pose, interior, self[member].pose
                            ).depth > MAX_PENETRATION}

    def _own(self, member: Member) -> float:
        local = self[member].local
        return self.scale(member[0]) * (local.evidence - self._least * local.length)

    def _pair(self, one: Member, other: Member) -> float:
        """Change of the log likelihood when both are present [nat]; -inf where they cannot be."""
        if one == other:
            return -np.inf
        key = (one, other) if one < other else (other, one)
        if key not in self._pair_values:
            self._pair_values[key] = self._joint(*key)
        return self._pair_values[key]

    def _joint(self, one: Member, other: Member) -> float:
        most = max(min(self._own(one), self._own(other)), 0.0)
        resolved = resolve_penetration(
            [PlacedObject(self._interiors[each[0]], self[each].pose, self[each].covariance)
             for each in (one, other)], most)
        if resolved.depth > MAX_PENETRATION or resolved.cost > most:
            return -np.inf
        changes = sum(self._change(*each) for each in ((one, other), (other, one)))
        return changes - resolved.cost

    def _change(self, member: Member, beside: Member) -> float:
        """Change of a candidate's log likelihood by the presence of another [nat]."""
        points, scale = self[member].points, self.scale(member[0])
        left = visible_evidence(points, [self[beside]], scale).value
        return scale * (left - float(points.lengths @ points.evidence))


def support_beside(observation: Observation, others: Sequence[Observation], scale: float,
                   least: float) -> float:
    """Support of a contour [nat / px] (`contour_support`); its hidden part is out of view.

    Minus infinity where the whole contour is more likely absent than present.
    """
    points = observation.points
    seen = visible_evidence(points, others, scale)
    lengths: NDArray[np.float64] = points.lengths * seen.weights
    if float(lengths @ points.evidence) <= least * lengths.sum():
        return -np.inf
    return contour_support(weighted(points, seen.weights), observation.in_view * seen.share)


def best_assignment(own: Sequence[NDArray[np.float64]],
                    pairs: Mapping[tuple[int, int], NDArray[np.float64]]) -> list[int | None]:
    """The assignment of a candidate, or None, to each object that has the largest sum of values.

    own: for each object the values (k,) of its candidates; None has the value 0; -inf excludes.
    pairs: for objects i < j the additional values (k_i, k_j) of two candidates together; -inf
        excludes both together. A missing pair adds 0.
    All assignments are compared. Raises LocalizationError where they are too many.
    """
    sizes = [len(each) + 1 for each in own]
    if np.prod(sizes, dtype=float) > MOST_ASSIGNMENTS:
        raise LocalizationError(f'{len(own)} objects of {[size - 1 for size in sizes]} candidates '
                                f'make more than {MOST_ASSIGNMENTS} assignments: list fewer '
                                'objects')
    total = np.zeros(sizes)
    for i, each in enumerate(own):
        total = total + _along(np.append(0.0, each), (i,), len(sizes))
    for (i, j), each in pairs.items():
        total = total + _along(np.pad(each, ((1, 0), (1, 0))), (i, j), len(sizes))
    chosen = np.unravel_index(int(total.argmax()), sizes)
    return [None if k == 0 else int(k) - 1 for k in chosen]


def most_candidates(objects: int) -> int:
    """Largest number of candidates of each of so many objects."""
    return int(MOST_ASSIGNMENTS ** (1 / objects)) - 1


def _along(values: NDArray[np.float64], axes: tuple[int, ...], count: int) -> NDArray[np.float64]:
    """The values, expanded to `count` axes: their own at `axes`, the others of length 1."""
    return np.expand_dims(values, tuple(k for k in range(count) if k not in axes))
