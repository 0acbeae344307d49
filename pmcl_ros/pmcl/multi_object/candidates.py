"""The poses that several objects may have in one capture, and which of them go together."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.modes import SAME_CANDIDATE
from pmcl_ros.pmcl.multi_object.assignment import best_choice, most_candidates
from pmcl_ros.pmcl.multi_object.penetration import DEEPEST, Placed, apart
from pmcl_ros.pmcl.multi_object.solid import Solid, contact
from pmcl_ros.pmcl.multi_object.visibility import sight
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.support import contour_support
from pmcl_ros.pmcl.tracking.observation import Observation, weighted

_MOST = 12  # candidates of an object

Member = tuple[int, int]  # number of the object, and of its candidate


class Candidates:
    """Of one capture.

    models, solids: of the distinct objects. listed: (n,) which of them is looked for, copies
    several times. least: evidence of a contour that is rather there than not [nat / px].
    least_support: as of `PmclSettings`.
    """

    def __init__(self, models: Sequence[ObjectModel], solids: Sequence[Solid],
                 listed: Sequence[int], least: float, least_support: float) -> None:
        self._models, self._solids, self._listed = models, solids, listed
        self._least, self._least_support = least, least_support
        self._looks: list[list[Observation]] = [[] for _ in models]
        self._scales: dict[int, float] = {}
        self._barred: set[Member] = set()
        self._known: dict[tuple[Member, Member], float] = {}

    def __getitem__(self, member: Member) -> Observation:
        return self._looks[member[0]][member[1]]

    def add(self, number: int, looks: Sequence[Observation]) -> list[Member]:
        """More poses of an object; of each, which candidate it is now, an old one if alike."""
        model, ours, members = self._models[number], self._looks[number], []
        for look in looks:
            known = np.array([each.pose for each in ours]).reshape(-1, 4, 4)
            alike = np.flatnonzero(model.symmetry.same_mode(known, look.pose, *SAME_CANDIDATE))
            members.append((number, int(alike[0]) if len(alike) else len(ours)))
            if not len(alike):
                ours.append(look)
        if number not in self._scales and ours:
            self._scales[number] = max(ours, key=lambda each: each.local.evidence).local.scale
        return members

    def worth(self, member: Member, beside: Iterable[Member]) -> float:
        """What a candidate is worth beside others [nat]; -inf where it cannot be."""
        return self._own(member) + sum(self._pair(member, each) for each in beside)

    def scale(self, number: int) -> float:
        """What an object's evidence is to be multiplied by to be a log likelihood.

        That of its best pose of the first search, so that all its candidates are compared alike.
        """
        return self._scales[number]

    def bar(self, member: Member) -> None:
        """Never choose that one again, nor what the evidence likes less in its place."""
        self._barred |= {member} | self._rivals(member)

    def chosen(self) -> list[Member | None]:
        """The best joint choice, (n,), of candidates that are supported beside each other.

        One whose contour is not supported there is no object: it must not hide others, nor take
        their edges or their place. So the least supported is left out, and chosen again; and with
        it what the object's evidence likes less in the same place.
        """
        barred = set(self._barred)
        while True:
            members = self._best(barred)
            supports = {each: self.support(each, members) for each in members if each is not None}
            worst = min(supports, key=lambda each: (supports[each], each), default=None)
            if worst is None or supports[worst] >= self._least_support:
                return members
            barred |= {worst} | self._rivals(worst)

    def support(self, member: Member, beside: Sequence[Member | None]) -> float:
        """Of the contour, with the others there (`support_beside`)."""
        return support_beside(self[member], self.others(member, beside), self.scale(member[0]),
                              self._least)

    def others(self, member: Member, beside: Sequence[Member | None]) -> list[Observation]:
        """The looks of the other members."""
        return [self[each] for each in beside if each is not None and each != member]

    def _best(self, barred: set[Member]) -> list[Member | None]:
        most = min(_MOST, most_candidates(len(self._listed)))
        members = []
        for number, looks in enumerate(self._looks):
            free = [(number, k) for k in range(len(looks)) if (number, k) not in barred]
            members.append(sorted(free, key=lambda each: -self._own(each))[:most])
        own = [np.array([self._own(each) for each in members[number]])
               for number in self._listed]
        pairs = {(i, j): np.array([[self._pair(one, other) for other in members[self._listed[j]]]
                                   for one in members[self._listed[i]]]
                                  ).reshape(len(own[i]), len(own[j]))
                 for j in range(len(own)) for i in range(j)}
        chosen = best_choice(own, pairs)
        return [None if k is None else members[number][k]
                for number, k in zip(self._listed, chosen, strict=True)]

    def _rivals(self, member: Member) -> set[Member]:
        """Candidates of the same object in the same place, of less evidence."""
        number, solid = member[0], self._solids[member[0]]
        return {(number, k) for k, look in enumerate(self._looks[number])
                if self._own((number, k)) < self._own(member)
                and contact(solid, look.pose, solid, self[member].pose).depth > DEEPEST}

    def _own(self, member: Member) -> float:
        local = self[member].local
        return self.scale(member[0]) * (local.evidence - self._least * local.length)

    def _pair(self, one: Member, other: Member) -> float:
        """What two are worth together, beside what each is worth [nat]."""
        if one == other:
            return -np.inf
        key = (one, other) if one < other else (other, one)
        if key not in self._known:
            self._known[key] = self._together(*key)
        return self._known[key]

    def _together(self, one: Member, other: Member) -> float:
        dearest = max(min(self._own(one), self._own(other)), 0.0)
        moved = apart([Placed(self._solids[each[0]], self[each].pose, self[each].covariance)
                       for each in (one, other)], dearest)
        if moved.depth > DEEPEST or moved.cost > dearest:
            return -np.inf
        changed = sum(self._seen(*each) for each in ((one, other), (other, one)))
        return changed - moved.cost

    def _seen(self, member: Member, beside: Member) -> float:
        """What becomes of one's evidence by another's being there [nat]."""
        points, scale = self[member].points, self.scale(member[0])
        left = sight(points, [self[beside]], scale).value
        return scale * (left - float(points.lengths @ points.evidence))


def support_beside(look: Observation, others: Sequence[Observation], scale: float,
                   least: float) -> float:
    """Of a contour, as `Localizer` asks for it, what is hidden being out of view [nat / px].

    Minus infinity where the whole of it is rather not there.
    """
    seen = sight(look.points, others, scale)
    lengths: NDArray[np.float64] = look.points.lengths * seen.weights
    if float(lengths @ look.points.evidence) <= least * lengths.sum():
        return -np.inf
    return contour_support(weighted(look.points, seen.weights), look.in_view * seen.share)
