"""EdgeVolume -> SceneEstimate: several objects in one capture."""

from collections.abc import Sequence

import numpy as np

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.names import distinct_names
from pmcl_ros.pmcl.multi_object.penetration import deepest_pair
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate
from pmcl_ros.pmcl.multi_object.scene_search import SceneSearch
from pmcl_ros.pmcl.multi_object.solid import Solid
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError
from pmcl_ros.runtime.progress import Progress

_MOST = 8  # objects


class SceneLocalizer:
    """Finds several objects in edge volumes; one may be listed several times: copies.

    Each is searched for alone; then poses, at most one of each object's, are chosen jointly; what
    is not found is searched for once more in what the others leave unexplained (see
    docs/concepts/several.md).
    models: listed. Copies are the same ObjectModel. Use and close it in one thread.
    Raises LocalizationError for no or too many objects, or names that are alike; RenderError when
    there is no GL.
    """

    def __init__(self, models: Sequence[ObjectModel], settings: PmclSettings,
                 profile: ContourProfile | None = None) -> None:
        self.names = tuple(distinct_names([each.name for each in models],
                                          [id(each) for each in models]))
        if len(models) > _MOST:
            raise LocalizationError(f'{len(models)} objects are listed, at most {_MOST} are '
                                    'looked for together')
        if settings.mode != 'default':
            raise LocalizationError(f'several objects need mode default, it is {settings.mode}')
        self._settings = settings
        self._least = (profile or ContourProfile.learned()).least
        self.models = tuple(models)
        self._distinct = list(dict.fromkeys(models))
        self._listed = [self._distinct.index(each) for each in models]
        self._solids = [Solid.of(each) for each in self._distinct]
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
        """Release the GL contexts, if there are some."""
        for each in self._localizers:
            each.close()

    def localize(self, edges: EdgeVolume, rng: np.random.Generator,
                 progress: Progress | None = None) -> SceneEstimate:
        """Where the listed objects are in one capture.

        progress: called with 0..1; once it returns False what was found so far is summed up.
        Raises LocalizationError for edges made of a likelihood, else what `Localizer.localize`
        raises.
        """
        if edges.from_likelihood:
            raise LocalizationError('several objects are told apart by their contours: they '
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
                             max(deepest_pair(there), 0.0))

    def _in_order(self, found: Sequence[PoseEstimate]) -> tuple[PoseEstimate, ...]:
        """Copies from left to right in the image, lost ones last: so that names are kept."""
        result = list(found)
        for number in set(self._listed):
            places = [k for k, each in enumerate(self._listed) if each == number]
            ours = sorted((found[k] for k in places), key=lambda each: (
                each.lost, each.pose[0, 3] / each.pose[2, 3]))
            for k, each in zip(places, ours, strict=True):
                result[k] = each
        return tuple(result)
