"""EvidenceVolume -> SceneEstimate: several objects in one capture."""

import re
from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.penetration import Solid, deepest_penetration
from pmcl_ros.pmcl.multi_object.scene_search import SceneSearch
from pmcl_ros.pmcl.multi_view.next_view import position_sigma
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError
from pmcl_ros.runtime.progress import Progress

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


class SceneLocalizer:
    """Finds several objects in edge volumes (docs/concepts/several.md).

    Each object is searched for alone. Then the poses are assigned jointly, at most one to each
    listed object. Missing objects are searched for again in the residual edges.
    models: listed; copies are the same ObjectModel. Use and close it in one thread.
    Raises LocalizationError for no or too many objects, or equal names; RenderError when there is
    no GL.
    """

    def __init__(self, models: Sequence[ObjectModel], settings: PmclSettings,
                 profile: ContourProfile | None = None) -> None:
        self.names = names_of(models, settings)
        if settings.evidence == 'map':
            raise LocalizationError('several objects need evidence edges, it is '
                                    f'{settings.evidence}')
        self._settings = settings
        self._least = (profile or ContourProfile.learned()).least
        self.models = tuple(models)
        self._distinct = list(dict.fromkeys(models))
        self._listed = [self._distinct.index(each) for each in models]
        self._solids = [Solid.from_model(each) for each in self._distinct]
        self._localizers: list[Localizer] = []
        try:
            for each in self._distinct:
                self._localizers.append(Localizer(each, settings, profile))
        except BaseException:
            self.close()
            raise
        self.renderer = self._localizers[0].renderer

    def __enter__(self) -> 'SceneLocalizer':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the GL contexts, if there are any."""
        for each in self._localizers:
            each.close()

    def localize(self, edges: EvidenceVolume, rng: np.random.Generator,
                 progress: Progress | None = None) -> SceneEstimate:
        """The poses of the listed objects in one capture.

        progress: called with 0..1; returning False ends the search with the poses found so far.
        Raises LocalizationError for edges made of a likelihood, else what `Localizer.localize`
        raises.
        """
        if isinstance(edges, EdgeVolume) and edges.from_likelihood:
            raise LocalizationError('several objects are distinguished by their contours: they '
                                    'need an edge volume (dlv/edges)')
        search = SceneSearch(self._localizers, self._distinct, self._solids, self._listed, edges,
                         rng, progress or (lambda _: True), self._least,
                         self._settings.least_support)
        found = search.run()
        estimates = self._in_order(found)
        there = [(self._solids[number], each.pose)
                 for number, each in zip(self._listed, estimates, strict=True) if not each.lost]
        return SceneEstimate(self.names, estimates,
                             tuple(search.alone[number] for number in self._listed),
                             max(deepest_penetration(there), 0.0))

    def _in_order(self, found: Sequence[PoseEstimate]) -> tuple[PoseEstimate, ...]:
        """Copies from left to right in the image, lost ones last, so that names stay."""
        result = list(found)
        for number in set(self._listed):
            places = [k for k, each in enumerate(self._listed) if each == number]
            ours = sorted((found[k] for k in places), key=lambda each: (
                each.lost, each.pose[0, 3] / each.pose[2, 3]))
            for k, each in zip(places, ours, strict=True):
                result[k] = each
        return tuple(result)


def names_of(models: Sequence[ObjectModel], settings: PmclSettings) -> tuple[str, ...]:
    """(n,) distinct names of listed models; copies are the same ObjectModel.

    Raises LocalizationError for no or too many objects, equal names, or another mode.
    """
    names = tuple(distinct_names([each.name for each in models], [id(each) for each in models]))
    if len(models) > _MOST:
        raise LocalizationError(f'{len(models)} objects are listed, at most {_MOST} are searched '
                                'for jointly')
    if settings.mode != 'default':
        raise LocalizationError(f'several objects need mode default, it is {settings.mode}')
    return names


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
