"""The objects that are looked for together, and the joint estimate of them."""

import re
from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_object.penetration import Interior, deepest_penetration
from pmcl_ros.pmcl.multi_view.next_view import position_sigma
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError

_MOST = 8  # objects


@dataclass(frozen=True)
class SceneEstimate:
    """The joint estimate of several objects in one capture.

    names: (n,) distinct; copies of one object are numbered. estimates: (n,); absent objects are
    lost. alone: (n,) estimates of the separate searches, without the other objects.
    depth: deepest penetration of two objects that are not lost [m], 0 without any.
    """

    names: tuple[str, ...]
    estimates: tuple[PoseEstimate, ...]
    alone: tuple[PoseEstimate, ...]
    depth: float

    @classmethod
    def of_one(cls, name: str, estimate: PoseEstimate) -> 'SceneEstimate':
        """Of one object, which was looked for alone."""
        return cls((name,), (estimate,), (estimate,), 0.0)

    def least_sure(self, models: Sequence[ObjectModel]) -> tuple[PoseEstimate, ObjectModel]:
        """The estimate whose position is the least certain, and its model.

        Of those that were found, if any was. models: (n,) of the objects.
        """
        both = zip(self.estimates, models, strict=True)
        return max(both, key=lambda each: (not each[0].lost, position_sigma(each[0].covariance)))

    def as_dict(self) -> dict[str, Any]:
        """The fields of the command line's JSON."""
        return {'objects': {name: each.as_dict() for name, each
                            in zip(self.names, self.estimates, strict=True)},
                'interpenetration': self.depth}

    def describe(self) -> str:
        """A line for each object."""
        return '\n'.join(f'{name}: {each.describe()}' for name, each
                         in zip(self.names, self.estimates, strict=True))


@dataclass(frozen=True)
class ListedObjects:
    """The objects that are looked for together; copies are the same ObjectModel.

    names: (n,) distinct. models: (n,).
    """

    names: tuple[str, ...]
    models: tuple[ObjectModel, ...]

    @classmethod
    def from_models(cls, models: Sequence[ObjectModel], settings: PmclSettings) -> 'ListedObjects':
        """Raises LocalizationError for no or too many objects, equal names, or another mode."""
        names = distinct_names([each.name for each in models], [id(each) for each in models])
        if len(models) > _MOST:
            raise LocalizationError(f'{len(models)} objects are listed, at most {_MOST} are '
                                    'searched for jointly')
        if settings.mode != 'default':
            raise LocalizationError('several objects need mode default, it is '
                                    f'{settings.mode}')
        return cls(tuple(names), tuple(models))

    @cached_property
    def distinct(self) -> list[ObjectModel]:
        """(m,) each object once."""
        return list(dict.fromkeys(self.models))

    @cached_property
    def numbers(self) -> list[int]:
        """(n,) of each among the distinct ones."""
        return [self.distinct.index(each) for each in self.models]

    @cached_property
    def interiors(self) -> list[Interior]:
        """(m,) of the distinct ones."""
        return [Interior.from_model(each) for each in self.distinct]

    def estimate(self, found: Sequence[PoseEstimate], alone: Sequence[PoseEstimate],
                 along: Callable[[NDArray[np.float64]], float]) -> SceneEstimate:
        """The joint estimate by those of each object (n,).

        alone: (m,) of the separate searches. along: of a pose (4, 4): copies are in ascending
        order of it, lost ones last, so that names stay.
        """
        result = list(found)
        for number in set(self.numbers):
            places = [k for k, each in enumerate(self.numbers) if each == number]
            ours = sorted((found[k] for k in places),
                          key=lambda each: (each.lost, along(each.pose)))
            for k, each in zip(places, ours, strict=True):
                result[k] = each
        there = [(self.interiors[number], each.pose)
                 for number, each in zip(self.numbers, result, strict=True) if not each.lost]
        return SceneEstimate(self.names, tuple(result),
                             tuple(alone[number] for number in self.numbers),
                             deepest_penetration(there))


def distinct_names(names: Sequence[str], kinds: Sequence[Hashable] = ()) -> list[str]:
    """Names of listed objects; copies are numbered from 2 on: `glass`, `glass_2`.

    kinds: of each name the object, the same for copies; by default the name itself.
    A name has letters, digits and underscores only, a letter first, as in names of topics. Raises
    LocalizationError when the list is empty or two objects have the same name.
    """
    if not names:
        raise LocalizationError('no objects are listed: name one at least')
    count: Counter[Hashable] = Counter()
    made = []
    for each, kind in zip(names, kinds or names, strict=True):
        plain = re.sub(r'_*[^0-9a-zA-Z_]+_*|__+', '_', each).strip('_')
        plain = plain if plain[:1].isalpha() else f'object_{plain}'.rstrip('_')
        count[kind] += 1
        made.append(plain if count[kind] == 1 else f'{plain}_{count[kind]}')
    for each, times in Counter(made).items():
        if times > 1:
            equal = [name for name, one in zip(names, made, strict=True) if one == each]
            raise LocalizationError(f'objects {equal} would all be called {each!r}: rename the '
                                    'file of one')
    return made
